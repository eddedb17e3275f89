#include "app/service_manager.hpp"

#include <systemd/sd-daemon.h>

namespace brdfgate {
namespace {

/// A fraction of any sensible WatchdogSec.
constexpr std::chrono::milliseconds kFeedEvery{500};

}  // namespace

void notify_ready() {
  sd_notify(0, "READY=1");
}

void notify_stopping() {
  sd_notify(0, "STOPPING=1");
}

bool ServiceWatchdog::alive(Time now, std::uint64_t progress) {
  if (progress != progress_ || moved_ == Time{}) {
    progress_ = progress;
    moved_ = now;
  }
  if (now - moved_ >= kStuck) return false;
  if (now - fed_ >= kFeedEvery) {
    fed_ = now;
    sd_notify(0, "WATCHDOG=1");
  }
  return true;
}

}  // namespace brdfgate
