#include "app/inspection_cycle.hpp"

#include "app/device_faults.hpp"
#include "app/result_json.hpp"
#include "model/error.hpp"

namespace brdfgate {

InspectionCycle::InspectionCycle(Station& station, const Inspector& inspector, PlcGate& gate,
                                 CycleMarks& marks, CameraConfig camera, Observer observer)
    : station_(station),
      inspector_(inspector),
      gate_(gate),
      marks_(marks),
      camera_(std::move(camera)),
      observer_(std::move(observer)) {}

void InspectionCycle::run(std::uint32_t trigger_id) {
  CyclePhase phase = CyclePhase::acquiring;
  while (phase != CyclePhase::done)
    phase = step(phase, trigger_id);
}

CyclePhase InspectionCycle::step(CyclePhase phase, std::uint32_t trigger_id) {
  try {
    switch (phase) {
      case CyclePhase::acquiring:
        return acquire(trigger_id);
      case CyclePhase::processing:
        return process();
      case CyclePhase::publishing:
        return publish();
      case CyclePhase::failed:
        return fail();
      case CyclePhase::done:
        break;
    }
  } catch (const DeviceError& error) {
    const DeviceFault device = fault_of(error);
    fault_ = {Reason::hardware, device.code, device.fault_class, error.what()};
    return CyclePhase::failed;
  } catch (const InputError& error) {
    fault_ = {Reason::hardware, ErrorCode::processing, "input", error.what()};
    return CyclePhase::failed;
  } catch (const std::exception& error) {
    fault_ = {Reason::hardware, ErrorCode::processing, "inspection", error.what()};
    return CyclePhase::failed;
  }
  return CyclePhase::done;
}

CyclePhase InspectionCycle::acquire(std::uint32_t trigger_id) {
  station_.next_part(trigger_id);
  capture_ = capture_part(station_, camera_, [this] { gate_.acquisition_done(); });
  ++marks_.capture;
  return CyclePhase::processing;
}

CyclePhase InspectionCycle::process() {
  inspection_ = inspector_.inspect(capture_, recipe_, age_);
  for (const Finding& finding : inspection_.result.findings) {
    if (finding.reason == Reason::hardware) throw LightsError("lights", "frames", finding.text);
  }
  ++marks_.judging;
  return CyclePhase::publishing;
}

CyclePhase InspectionCycle::publish() {
  const auto published = gate_.publish(inspection_.result);
  if (published) {
    spdlog::info(
        "part {}: {} in {} ms{}{}", published->trigger_id, to_text(published->verdict),
        published->cycle_ms, inspection_.result.findings.empty() ? "" : ": ",
        inspection_.result.findings.empty() ? "" : inspection_.result.findings.front().text);
  }
  if (observer_) observer_(inspection_, published);
  return CyclePhase::done;
}

CyclePhase InspectionCycle::fail() {
  station_.lights().all_off();
  station_.camera().stop();
  faults_.report(fault_.fault_class, fault_.text);
  gate_.abort(bit(fault_.reason), ResultState::failed, fault_.error);
  return CyclePhase::done;
}

}  // namespace brdfgate
