#include "hal/gpio/gpio_outputs.hpp"

namespace brdfgate {

GpioOutputs::GpioOutputs(const GpioOutputsSettings& settings) : settings_(settings) {
  std::vector<GpioOutputLine> lines;
  for (const auto* line : {&settings.pass, &settings.reject, &settings.busy}) {
    if (*line) lines.push_back(**line);
  }
  lines_ = std::make_unique<GpioOutputLines>(settings.chip, lines, "brdfgate outputs");
  set(kFailSafeOutputs);
}

GpioOutputs::~GpioOutputs() {
  try {
    set(kFailSafeOutputs);
  } catch (const DeviceError&) {
    // the chip has gone: the wiring decides
  }
}

void GpioOutputs::set(const GpioOutputState& state) {
  std::vector<bool> levels;
  if (settings_.pass) levels.push_back(state.pass);
  if (settings_.reject) levels.push_back(state.reject);
  if (settings_.busy) levels.push_back(state.busy);
  lines_->set(levels);
}

}  // namespace brdfgate
