// The white reference over time: lamps that drift, certificates that run out, light that strays.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "model/calibration.hpp"

namespace brdfgate {

/// Per light: how much brighter the white reference is now than in the last calibration, relative:
/// the median over all cells good in both, channels summed. Throws InputError where the two are of
/// other lights, sizes or channels (a foreign calibration), or share no good cell.
std::vector<double> lamp_drift(const Calibration& last, const Calibration& now);

/// Per light: radiance of a black gauge over the white reference's, the median of the worst
/// channel. What exceeds the gauge's own reflectance over the reference's is stray light and light
/// reflected between part, nest and housing. Throws InputError as lamp_drift does.
std::vector<double> stray_share(const std::vector<Radiance>& black, const Calibration& calibration);

/// A date as YYYY-MM-DD that exists, else an InputError that names `where`.
void check_date(const std::string& date, const std::string& where);

/// Days from `today` to the certificate's due date, negative when past; nothing where it has none.
/// Both dates must be valid.
std::optional<int> days_until_due(const WhiteCertificate& certificate, const std::string& today);

/// The same of a calibration, which is due when its certificate ends or when it is older than
/// `max_age_days` (0: any age will do), whichever comes first. Throws InputError where a date that
/// counts does not exist.
std::optional<int> days_until_due(const Calibration& calibration, int max_age_days,
                                  const std::string& today);

}  // namespace brdfgate
