// One part's cycle as a state machine: acquire, process, publish; any fault ends in "not judged".
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>

#include "app/fault_log.hpp"
#include "app/inspector.hpp"
#include "app/plc/plc_gate.hpp"
#include "app/station.hpp"

namespace brdfgate {

/// Where a part stands. The order is the only one possible; `failed` can follow any but `done`.
enum class CyclePhase { acquiring, processing, publishing, failed, done };

/// Numbers that move while the daemon gets on with its work; read by the heartbeat.
struct CycleMarks {
  std::atomic<std::uint64_t> capture{0};
  std::atomic<std::uint64_t> judging{0};
};

class InspectionCycle {
 public:
  /// Told of every completed inspection and how it was published (not at all, where it was aborted
  /// meanwhile), on the inspection's thread: must not block.
  using Observer = std::function<void(const Inspection&, const std::optional<PublishedTimes>&)>;

  InspectionCycle(Station& station, const Inspector& inspector, PlcGate& gate, CycleMarks& marks,
                  CameraConfig camera, Observer observer);

  /// The recipe for the parts to come; none: everything is "not judged".
  void use(const RecipeInForce* recipe) { recipe_ = recipe; }
  /// How old the calibration is, for the parts to come.
  void use(const CalibrationAge& age) { age_ = age; }

  /// One part from trigger to result. Never throws: a fault is logged once per class and published
  /// as "not judged" with its reason and error code.
  void run(std::uint32_t trigger_id);

 private:
  CyclePhase acquire(std::uint32_t trigger_id);
  CyclePhase process();
  CyclePhase publish();
  CyclePhase fail();
  CyclePhase step(CyclePhase phase, std::uint32_t trigger_id);

  Station& station_;
  const Inspector& inspector_;
  PlcGate& gate_;
  CycleMarks& marks_;
  const CameraConfig camera_;
  Observer observer_;
  const RecipeInForce* recipe_ = nullptr;
  CalibrationAge age_;
  FaultLog faults_;

  /// The part in work.
  Capture capture_;
  Inspection inspection_;
  struct Fault {
    Reason reason = Reason::hardware;
    ErrorCode error = ErrorCode::none;
    std::string fault_class;
    std::string text;
  } fault_;
};

}  // namespace brdfgate
