// Pictures of the last part and the page that explains them, drawn and written beside the
// inspection, never in its way.
#pragma once

#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <optional>
#include <thread>

#include "app/inspector.hpp"
#include "app/result_json.hpp"

namespace brdfgate {

/// What the page says of a part beside the inspection itself.
struct PartPapers {
  const RecipeInForce* recipe = nullptr;  ///< nullptr: none; outlives the writer
  std::string name;
  std::string station_hash;
  std::string recipe_hash;  ///< empty: none
  CycleTimes times;
};

/// The part with the verdict that the PLC was told: a station that fell into error while it was
/// judged withdraws a pass, and nothing may show one.
Inspection as_published(Inspection part, Verdict verdict);

/// Holds at most one part: a newer one replaces one that was not drawn yet.
class EvidenceWriter {
 public:
  EvidenceWriter(std::filesystem::path dir, const Inspector& inspector);
  EvidenceWriter(const EvidenceWriter&) = delete;
  EvidenceWriter& operator=(const EvidenceWriter&) = delete;
  /// Draws what is still waiting, then returns.
  ~EvidenceWriter();

  void offer(const Inspection& part, PartPapers papers);

 private:
  struct Waiting {
    Inspection part;
    PartPapers papers;
  };
  void work(const std::stop_token& stop);
  void write(const Waiting& last) const;

  std::filesystem::path dir_;
  const Inspector& inspector_;
  std::mutex mutex_;
  std::condition_variable_any offered_;
  std::optional<Waiting> waiting_;
  std::jthread thread_;
};

}  // namespace brdfgate
