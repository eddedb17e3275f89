// libgpiod 2.x.
#include <gpiod.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "hal/gpio/gpiod.hpp"

namespace brdfgate {
namespace {

template <auto Free>
struct FreeBy {
  template <typename T>
  void operator()(T* handle) const {
    Free(handle);
  }
};
using Chip = std::unique_ptr<gpiod_chip, FreeBy<gpiod_chip_close>>;
using ChipInfo = std::unique_ptr<gpiod_chip_info, FreeBy<gpiod_chip_info_free>>;
using LineSettings = std::unique_ptr<gpiod_line_settings, FreeBy<gpiod_line_settings_free>>;
using LineConfig = std::unique_ptr<gpiod_line_config, FreeBy<gpiod_line_config_free>>;
using RequestConfig = std::unique_ptr<gpiod_request_config, FreeBy<gpiod_request_config_free>>;
using LineRequest = std::unique_ptr<gpiod_line_request, FreeBy<gpiod_line_request_release>>;
using EventBuffer = std::unique_ptr<gpiod_edge_event_buffer, FreeBy<gpiod_edge_event_buffer_free>>;

/// Takes errno: call it right after what failed.
[[noreturn]] void fail(const std::string& device, const std::string& call) {
  const int error = errno;
  std::string what = std::strerror(error);
  if (error == EBUSY) what += ": another program or driver holds it (gpioinfo tells which)";
  throw DeviceError(device, call, what);
}

bool is_called(gpiod_chip* chip, const std::string& name) {
  const ChipInfo info(gpiod_chip_get_info(chip));
  return info && (name == gpiod_chip_info_get_name(info.get()) ||
                  name == gpiod_chip_info_get_label(info.get()));
}

Chip open_chip(const std::string& name) {
  if (gpiod_is_gpiochip_device(name.c_str())) {
    if (Chip chip{gpiod_chip_open(name.c_str())}) return chip;
    fail(name, "open");
  }
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator("/dev", none)) {
    if (!gpiod_is_gpiochip_device(entry.path().c_str())) continue;
    Chip chip(gpiod_chip_open(entry.path().c_str()));
    if (chip && is_called(chip.get(), name)) return chip;
  }
  throw DeviceError(name, "open", "no such GPIO chip; gpiodetect lists them");
}

unsigned find_line(const Chip& chip, const std::string& chip_name, const std::string& line) {
  const ChipInfo info(gpiod_chip_get_info(chip.get()));
  if (!info) fail(chip_name, "info");
  const auto number = gpio_line_number(line);
  if (number && *number < gpiod_chip_info_get_num_lines(info.get())) return *number;
  const int found = number ? -1 : gpiod_chip_get_line_offset_from_name(chip.get(), line.c_str());
  if (found < 0) {
    throw DeviceError(chip_name, "line " + line, "no such line; gpioinfo lists them");
  }
  return static_cast<unsigned>(found);
}

gpiod_line_bias bias_of(GpioBias bias) {
  switch (bias) {
    case GpioBias::as_is:
      return GPIOD_LINE_BIAS_AS_IS;
    case GpioBias::none:
      return GPIOD_LINE_BIAS_DISABLED;
    case GpioBias::pull_up:
      return GPIOD_LINE_BIAS_PULL_UP;
    case GpioBias::pull_down:
      return GPIOD_LINE_BIAS_PULL_DOWN;
  }
  return GPIOD_LINE_BIAS_AS_IS;
}

gpiod_line_value level(bool high) {
  return high ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
}

LineRequest request(const Chip& chip, const LineConfig& lines, const std::string& consumer) {
  const RequestConfig config(gpiod_request_config_new());
  if (!config) return {};
  gpiod_request_config_set_consumer(config.get(), consumer.c_str());
  return LineRequest(gpiod_chip_request_lines(chip.get(), config.get(), lines.get()));
}

LineRequest request_edges(const Chip& chip, unsigned line, const GpioTriggerSettings& settings,
                          bool debounce, const std::string& consumer) {
  const LineSettings line_settings(gpiod_line_settings_new());
  const LineConfig config(gpiod_line_config_new());
  if (!line_settings || !config) return {};
  gpiod_line_settings_set_direction(line_settings.get(), GPIOD_LINE_DIRECTION_INPUT);
  // One edge is enough but where they are debounced here (see gpiod_v1.cpp).
  const bool both = settings.debounce.count() > 0 && !debounce;
  gpiod_line_settings_set_edge_detection(line_settings.get(), both ? GPIOD_LINE_EDGE_BOTH
                                                              : settings.edge == GpioEdge::rising
                                                                  ? GPIOD_LINE_EDGE_RISING
                                                                  : GPIOD_LINE_EDGE_FALLING);
  gpiod_line_settings_set_bias(line_settings.get(), bias_of(settings.bias));
  gpiod_line_settings_set_event_clock(line_settings.get(), GPIOD_LINE_CLOCK_MONOTONIC);
  if (debounce) {
    gpiod_line_settings_set_debounce_period_us(
        line_settings.get(), static_cast<unsigned long>(settings.debounce.count()));
  }
  if (gpiod_line_config_add_line_settings(config.get(), &line, 1, line_settings.get()) != 0) {
    return {};
  }
  return request(chip, config, consumer);
}

}  // namespace

struct GpioOutputLines::Request {
  LineRequest lines;
  std::string name;
};

GpioOutputLines::GpioOutputLines(const std::string& chip_name,
                                 const std::vector<GpioOutputLine>& lines,
                                 const std::string& consumer)
    : request_(std::make_unique<Request>()) {
  const Chip chip = open_chip(chip_name);
  const LineConfig config(gpiod_line_config_new());
  const LineSettings settings(gpiod_line_settings_new());
  request_->name = chip_name;
  if (!config || !settings) fail(chip_name, "request");
  gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_OUTPUT);
  for (const GpioOutputLine& line : lines) {
    const unsigned offset = find_line(chip, chip_name, line.line);
    request_->name += (active_low_.empty() ? " line " : ", ") + line.line;
    active_low_.push_back(line.active_low);
    gpiod_line_settings_set_output_value(settings.get(), level(line.active_low));
    if (gpiod_line_config_add_line_settings(config.get(), &offset, 1, settings.get()) != 0) {
      fail(request_->name, "request");
    }
  }
  request_->lines = request(chip, config, consumer);
  if (!request_->lines) fail(request_->name, "request");
}

GpioOutputLines::~GpioOutputLines() = default;

void GpioOutputLines::set(const std::vector<bool>& active) {
  std::vector<gpiod_line_value> levels(active_low_.size());
  for (std::size_t i = 0; i < levels.size(); ++i)
    levels[i] = level(active[i] != active_low_[i]);
  if (gpiod_line_request_set_values(request_->lines.get(), levels.data()) != 0) {
    fail(request_->name, "set");
  }
}

std::vector<bool> GpioOutputLines::get() {
  std::vector<gpiod_line_value> levels(active_low_.size());
  if (gpiod_line_request_get_values(request_->lines.get(), levels.data()) != 0) {
    fail(request_->name, "get");
  }
  std::vector<bool> active(levels.size());
  for (std::size_t i = 0; i < levels.size(); ++i)
    active[i] = (levels[i] == GPIOD_LINE_VALUE_ACTIVE) != active_low_[i];
  return active;
}

struct GpioEdgeInput::Request {
  LineRequest line;
  EventBuffer events;
  unsigned offset = 0;
  bool debounced = false;
  std::string name;
};

GpioEdgeInput::GpioEdgeInput(const GpioTriggerSettings& settings, const std::string& consumer)
    : request_(std::make_unique<Request>()) {
  const Chip chip = open_chip(settings.chip);
  request_->name = settings.chip + " line " + settings.line;
  request_->offset = find_line(chip, settings.chip, settings.line);
  request_->events.reset(gpiod_edge_event_buffer_new(1));
  if (!request_->events) fail(request_->name, "request edges");
  if (settings.debounce.count() > 0) {
    request_->line = request_edges(chip, request_->offset, settings, true, consumer);
    request_->debounced = request_->line != nullptr;
  }
  // A driver without debounce refuses the request as a whole.
  if (!request_->line) {
    request_->line = request_edges(chip, request_->offset, settings, false, consumer);
  }
  if (!request_->line) fail(request_->name, "request edges");
}

GpioEdgeInput::~GpioEdgeInput() = default;

bool GpioEdgeInput::debounced() const {
  return request_->debounced;
}

bool GpioEdgeInput::high() {
  const auto value = gpiod_line_request_get_value(request_->line.get(), request_->offset);
  if (value == GPIOD_LINE_VALUE_ERROR) fail(request_->name, "get");
  return value == GPIOD_LINE_VALUE_ACTIVE;
}

std::optional<GpioEdgeEvent> GpioEdgeInput::wait(std::chrono::nanoseconds timeout) {
  const std::int64_t ns = std::max<std::int64_t>(0, timeout.count());
  const int ready = gpiod_line_request_wait_edge_events(request_->line.get(), ns);
  if (ready < 0 && errno != EINTR) fail(request_->name, "wait");
  if (ready <= 0) {
    (void)high();  // a chip that has gone wakes nobody
    return std::nullopt;
  }
  if (gpiod_line_request_read_edge_events(request_->line.get(), request_->events.get(), 1) < 1) {
    fail(request_->name, "read");
  }
  gpiod_edge_event* const event = gpiod_edge_event_buffer_get_event(request_->events.get(), 0);
  return GpioEdgeEvent{gpiod_edge_event_get_event_type(event) == GPIOD_EDGE_EVENT_RISING_EDGE,
                       static_cast<std::int64_t>(gpiod_edge_event_get_timestamp_ns(event))};
}

}  // namespace brdfgate
