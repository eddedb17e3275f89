// libgpiod 1.6.
#include <gpiod.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "hal/gpio/gpiod.hpp"

namespace brdfgate {
namespace {

struct CloseChip {
  void operator()(gpiod_chip* chip) const { gpiod_chip_close(chip); }
};
using Chip = std::unique_ptr<gpiod_chip, CloseChip>;

/// Takes errno: call it right after what failed.
[[noreturn]] void fail(const std::string& device, const std::string& call) {
  const int error = errno;
  std::string what = std::strerror(error);
  if (error == EBUSY) what += ": another program or driver holds it (gpioinfo tells which)";
  throw DeviceError(device, call, what);
}

Chip open_chip(const std::string& name) {
  Chip chip(gpiod_chip_open_lookup(name.c_str()));
  if (!chip) throw DeviceError(name, "open", "no such GPIO chip; gpiodetect lists them");
  return chip;
}

gpiod_line* find_line(const Chip& chip, const std::string& line) {
  const auto number = gpio_line_number(line);
  gpiod_line* const found = number ? gpiod_chip_get_line(chip.get(), *number)
                                   : gpiod_chip_find_line(chip.get(), line.c_str());
  if (found == nullptr) {
    throw DeviceError(gpiod_chip_name(chip.get()), "line " + line,
                      "no such line; gpioinfo lists them");
  }
  return found;
}

int bias_flag(GpioBias bias) {
  switch (bias) {
    case GpioBias::as_is:
      return 0;
    case GpioBias::none:
      return GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE;
    case GpioBias::pull_up:
      return GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP;
    case GpioBias::pull_down:
      return GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN;
  }
  return 0;
}

timespec to_timespec(std::chrono::nanoseconds time) {
  const auto seconds = std::chrono::floor<std::chrono::seconds>(time);
  return {seconds.count(), (time - seconds).count()};
}

}  // namespace

struct GpioOutputLines::Request {
  Chip chip;  ///< closing it lets go of the lines
  gpiod_line_bulk lines{};
  std::string name;
};

GpioOutputLines::GpioOutputLines(const std::string& chip, const std::vector<GpioOutputLine>& lines,
                                 const std::string& consumer)
    : request_(std::make_unique<Request>(Request{open_chip(chip), {}, chip})) {
  if (lines.size() > GPIOD_LINE_BULK_MAX_LINES)
    throw DeviceError(chip, "request", "too many lines");
  gpiod_line_bulk_init(&request_->lines);
  std::vector<int> levels;
  for (const GpioOutputLine& line : lines) {
    gpiod_line_bulk_add(&request_->lines, find_line(request_->chip, line.line));
    active_low_.push_back(line.active_low);
    levels.push_back(line.active_low ? 1 : 0);
    request_->name += (levels.size() == 1 ? " line " : ", ") + line.line;
  }
  if (gpiod_line_request_bulk_output(&request_->lines, consumer.c_str(), levels.data()) != 0) {
    fail(request_->name, "request");
  }
}

GpioOutputLines::~GpioOutputLines() = default;

void GpioOutputLines::set(const std::vector<bool>& active) {
  std::vector<int> levels(active_low_.size());
  for (std::size_t i = 0; i < levels.size(); ++i)
    levels[i] = active[i] != active_low_[i] ? 1 : 0;
  if (gpiod_line_set_value_bulk(&request_->lines, levels.data()) != 0) {
    fail(request_->name, "set");
  }
}

std::vector<bool> GpioOutputLines::get() {
  std::vector<int> levels(active_low_.size());
  if (gpiod_line_get_value_bulk(&request_->lines, levels.data()) != 0) {
    fail(request_->name, "get");
  }
  std::vector<bool> active(levels.size());
  for (std::size_t i = 0; i < levels.size(); ++i)
    active[i] = (levels[i] != 0) != active_low_[i];
  return active;
}

struct GpioEdgeInput::Request {
  Chip chip;  ///< closing it lets go of the line
  gpiod_line* line = nullptr;
  std::string name;
};

GpioEdgeInput::GpioEdgeInput(const GpioTriggerSettings& settings, const std::string& consumer)
    : request_(std::make_unique<Request>(Request{open_chip(settings.chip), nullptr, {}})) {
  request_->name = settings.chip + " line " + settings.line;
  request_->line = find_line(request_->chip, settings.line);
  // The kernel tells the edges of a line by its level when the interrupt's thread runs: with both,
  // a short pulse would read as its own end. Without debounce one edge is enough.
  auto* const request = settings.debounce.count() > 0 ? &gpiod_line_request_both_edges_events_flags
                        : settings.edge == GpioEdge::rising
                            ? &gpiod_line_request_rising_edge_events_flags
                            : &gpiod_line_request_falling_edge_events_flags;
  if (request(request_->line, consumer.c_str(), bias_flag(settings.bias)) != 0) {
    fail(request_->name, "request edges");
  }
}

GpioEdgeInput::~GpioEdgeInput() = default;

bool GpioEdgeInput::debounced() const {
  return false;
}

bool GpioEdgeInput::high() {
  const int level = gpiod_line_get_value(request_->line);
  if (level < 0) fail(request_->name, "get");
  return level != 0;
}

std::optional<GpioEdgeEvent> GpioEdgeInput::wait(std::chrono::nanoseconds timeout) {
  const timespec time = to_timespec(std::max(timeout, std::chrono::nanoseconds(0)));
  const int ready = gpiod_line_event_wait(request_->line, &time);
  if (ready < 0 && errno != EINTR) fail(request_->name, "wait");
  if (ready <= 0) {
    (void)high();  // a chip that has gone wakes nobody
    return std::nullopt;
  }
  gpiod_line_event event{};
  if (gpiod_line_event_read(request_->line, &event) != 0) fail(request_->name, "read");
  return GpioEdgeEvent{event.event_type == GPIOD_LINE_EVENT_RISING_EDGE,
                       event.ts.tv_sec * 1'000'000'000LL + event.ts.tv_nsec};
}

}  // namespace brdfgate
