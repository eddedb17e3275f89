// The time that files and reports are stamped with.
#pragma once

#include <string>

namespace brdfgate {

/// Now, ISO 8601, UTC: 2026-03-01T09:30:00Z.
std::string utc_now();

}  // namespace brdfgate
