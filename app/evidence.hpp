// Pictures of the last part, drawn and written beside the inspection, never in its way.
#pragma once

#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <optional>
#include <thread>

#include "app/inspector.hpp"

namespace brdfgate {

/// Holds at most one part: a newer one replaces one that was not drawn yet.
class EvidenceWriter {
 public:
  EvidenceWriter(std::filesystem::path dir, const Inspector& inspector);
  EvidenceWriter(const EvidenceWriter&) = delete;
  EvidenceWriter& operator=(const EvidenceWriter&) = delete;
  /// Draws what is still waiting, then returns.
  ~EvidenceWriter();

  void offer(const Inspection& part);

 private:
  void work(const std::stop_token& stop);

  std::filesystem::path dir_;
  const Inspector& inspector_;
  std::mutex mutex_;
  std::condition_variable_any offered_;
  std::optional<Inspection> waiting_;
  std::jthread thread_;
};

}  // namespace brdfgate
