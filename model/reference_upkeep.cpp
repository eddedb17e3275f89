#include "model/reference_upkeep.hpp"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>

#include "model/error.hpp"

namespace brdfgate {
namespace {

std::optional<std::chrono::sys_days> parsed(const std::string& date) {
  int year = 0;
  unsigned int month = 0, day = 0;
  const auto number = [&date](std::size_t at, std::size_t length, auto& into) {
    const char* end = date.data() + at + length;
    return std::from_chars(date.data() + at, end, into).ptr == end;
  };
  const bool read = date.size() == 10 && date[4] == '-' && date[7] == '-' && number(0, 4, year) &&
                    number(5, 2, month) && number(8, 2, day);
  const std::chrono::year_month_day calendar{std::chrono::year(year), std::chrono::month(month),
                                             std::chrono::day(day)};
  if (!read || !calendar.ok()) return std::nullopt;
  return std::chrono::sys_days(calendar);
}

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Ratios of one cell: each channel's, or that of the channels' sums where there is one list.
void add_ratios(const float* x, const float* y, std::size_t channels,
                std::vector<std::vector<double>>& ratios) {
  double sum_x = 0, sum_y = 0;
  for (std::size_t c = 0; c < channels; ++c) {
    sum_x += x[c];
    sum_y += y[c];
    if (ratios.size() > 1 && y[c] > 0) ratios[c].push_back(static_cast<double>(x[c]) / y[c]);
  }
  if (ratios.size() == 1 && sum_y > 0) ratios[0].push_back(sum_x / sum_y);
}

/// Median over cells good in both of one radiance over the other: of the channels' sums, or of the
/// channel where that median is greatest.
double median_ratio(const Radiance& a, const Radiance& b, const std::string& where, bool worst) {
  if (a.value.size() != b.value.size() || a.value.type() != b.value.type()) {
    throw InputError(where, "an image of another size or number of channels",
                     "a calibration of this camera");
  }
  const auto channels = static_cast<std::size_t>(a.value.channels());
  std::vector<std::vector<double>> ratios(worst ? channels : 1);
  for (int v = 0; v < a.value.rows; ++v) {
    const auto* x = a.value.ptr<float>(v);
    const auto* y = b.value.ptr<float>(v);
    for (int u = 0; u < a.value.cols; ++u, x += channels, y += channels) {
      // A dark gauge in the noise floor still says how dark it is; a clipped cell says nothing.
      if ((a.mask.at<std::uint8_t>(v, u) & (kClipped | kInvalid)) != 0) continue;
      if (b.mask.at<std::uint8_t>(v, u) != 0) continue;
      add_ratios(x, y, channels, ratios);
    }
  }
  double greatest = -HUGE_VAL;
  for (std::vector<double>& channel : ratios) {
    if (channel.empty()) throw InputError(where, "no cell that is good in both", "a lit plate");
    greatest = std::max(greatest, median_of(channel));
  }
  return greatest;
}

void check_lights(std::size_t seen, std::size_t expected) {
  if (seen != expected) {
    throw InputError("last calibration", std::to_string(seen) + " lights",
                     std::to_string(expected) + " as now");
  }
}

}  // namespace

std::vector<double> lamp_drift(const Calibration& last, const Calibration& now) {
  check_lights(last.white.size(), now.white.size());
  std::vector<double> out;
  for (std::size_t l = 0; l < now.white.size(); ++l) {
    const std::string where = "last calibration, light " + std::to_string(l + 1);
    out.push_back(median_ratio(now.white[l], last.white[l], where, false) - 1);
  }
  return out;
}

std::vector<double> stray_share(const std::vector<Radiance>& black,
                                const Calibration& calibration) {
  check_lights(black.size(), calibration.white.size());
  std::vector<double> out;
  for (std::size_t l = 0; l < black.size(); ++l) {
    const std::string where = "black gauge, light " + std::to_string(l + 1);
    out.push_back(median_ratio(black[l], calibration.white[l], where, true));
  }
  return out;
}

void check_date(const std::string& date, const std::string& where) {
  if (!parsed(date)) throw InputError(where, "'" + date + "' is no date", "YYYY-MM-DD");
}

std::optional<int> days_until_due(const WhiteCertificate& certificate, const std::string& today) {
  if (certificate.due.empty()) return std::nullopt;
  check_date(certificate.due, "certificate's due date");
  check_date(today, "today");
  return static_cast<int>((*parsed(certificate.due) - *parsed(today)).count());
}

std::optional<int> days_until_due(const Calibration& calibration, int max_age_days,
                                  const std::string& today) {
  std::optional<int> days = days_until_due(calibration.certificate, today);
  if (max_age_days <= 0) return days;
  const std::string made = calibration.created.substr(0, 10);
  check_date(made, "calibration's date");
  check_date(today, "today");
  const int left = max_age_days - static_cast<int>((*parsed(today) - *parsed(made)).count());
  return days ? std::min(*days, left) : left;
}

}  // namespace brdfgate
