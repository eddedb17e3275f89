#include "app/evidence.hpp"

#include <spdlog/spdlog.h>

#include "app/explain.hpp"
#include "app/pictures.hpp"

namespace brdfgate {

Inspection as_published(Inspection part, Verdict verdict) {
  PartResult& result = part.result;
  if (verdict == result.verdict) return part;
  result.verdict = verdict;
  result.reason_bits |= bit(Reason::hardware);
  result.findings.insert(result.findings.begin(),
                         {Reason::hardware, "the station was in error before the result stood"});
  return part;
}

EvidenceWriter::EvidenceWriter(std::filesystem::path dir, const Inspector& inspector)
    : dir_(std::move(dir)),
      inspector_(inspector),
      thread_([this](const std::stop_token& stop) { work(stop); }) {}

EvidenceWriter::~EvidenceWriter() {
  thread_.request_stop();
  thread_.join();
}

void EvidenceWriter::offer(const Inspection& part, PartPapers papers) {
  {
    const std::lock_guard lock(mutex_);
    waiting_ = {part, std::move(papers)};
  }
  offered_.notify_one();
}

void EvidenceWriter::work(const std::stop_token& stop) {
  while (true) {
    std::unique_lock lock(mutex_);
    offered_.wait(lock, stop, [this] { return waiting_.has_value(); });
    if (!waiting_) return;  // stopped, and nothing left to draw
    const Waiting last = std::move(*waiting_);
    waiting_.reset();
    lock.unlock();
    try {
      write(last);
    } catch (const std::exception& error) {
      spdlog::warn("pictures of the last part: {}", error.what());
    }
  }
}

void EvidenceWriter::write(const Waiting& last) const {
  const auto& [part, papers] = last;
  // A part whose lights did not work has nothing to show.
  if (!part.reflectance.empty()) write_pictures(dir_, draw(part, inspector_));
  write_explanation(dir_, {part, inspector_, papers.recipe, papers.name, papers.station_hash,
                           papers.recipe_hash, papers.times});
}

}  // namespace brdfgate
