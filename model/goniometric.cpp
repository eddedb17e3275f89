#include "model/goniometric.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <numbers>

#include "model/error.hpp"
#include "model/estimator.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

constexpr double kPi = std::numbers::pi;
constexpr std::uintmax_t kMaxBytes = 256u << 20;
constexpr int kMaxWavelengths = 10000;
constexpr std::size_t kAngles = 4;

/// The lines that say something, as numbers.
class Lines {
 public:
  Lines(std::string_view text, const std::string& name) : text_(text), name_(name) {}

  /// The next line with numbers on it; false at the end.
  bool next(std::vector<double>& numbers) {
    while (!text_.empty()) {
      const std::size_t end = std::min(text_.find('\n'), text_.size());
      std::string_view line = text_.substr(0, end);
      text_.remove_prefix(std::min(end + 1, text_.size()));
      ++line_;
      line = line.substr(0, line.find('#'));
      parse(line, numbers);
      if (!numbers.empty()) return true;
    }
    return false;
  }

  [[noreturn]] void fail(const std::string& what, const std::string& expected) const {
    throw InputError(name_ + ":" + std::to_string(line_), what, expected);
  }

 private:
  void parse(std::string_view line, std::vector<double>& numbers) const {
    constexpr std::string_view kBlank = " \t\r\v\f";
    numbers.clear();
    for (;;) {
      line.remove_prefix(std::min(line.find_first_not_of(kBlank), line.size()));
      if (line.empty()) return;
      const std::string_view word = line.substr(0, line.find_first_of(kBlank));
      double value = 0;
      const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
      if (error != std::errc() || end != word.data() + word.size()) {
        constexpr std::size_t kShown = 40;
        fail("'" + std::string(word.substr(0, kShown)) + "' is no number", "numbers and blanks");
      }
      numbers.push_back(value);
      line.remove_prefix(word.size());
    }
  }

  std::string_view text_;
  std::string name_;
  int line_ = 0;
};

/// The wavelengths after a line that holds their number alone.
std::vector<double> read_wavelengths(Lines& lines, double count) {
  if (!(count >= 1 && count <= kMaxWavelengths && count == std::floor(count))) {
    lines.fail(std::to_string(count) + " wavelengths",
               "a whole number from 1 to " + std::to_string(kMaxWavelengths));
  }
  std::vector<double> wavelengths;
  std::vector<double> numbers;
  while (wavelengths.size() < static_cast<std::size_t>(count)) {
    if (!lines.next(numbers)) {
      lines.fail("the list ends after " + std::to_string(wavelengths.size()) + " wavelengths",
                 std::to_string(int(count)));
    }
    for (const double w : numbers) {
      if (!(std::isfinite(w) && w > (wavelengths.empty() ? 0.0 : wavelengths.back()))) {
        lines.fail("wavelength " + std::to_string(w), "rising wavelengths in nm");
      }
      wavelengths.push_back(w);
    }
  }
  if (wavelengths.size() > static_cast<std::size_t>(count)) {
    lines.fail(std::to_string(wavelengths.size()) + " wavelengths", std::to_string(int(count)));
  }
  return wavelengths;
}

Eigen::Vector3d direction(double theta, double phi) {
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

HalfDiff read_angles(const Lines& lines, const std::vector<double>& numbers) {
  for (const std::size_t theta : {0, 2}) {
    if (!(numbers[theta] >= 0 && numbers[theta] < kPi / 2)) {
      lines.fail(std::string(theta == 0 ? "theta_i " : "theta_o ") +
                     std::to_string(numbers[theta]) + " rad is not above the horizon",
                 "0 to below pi / 2");
    }
  }
  for (const std::size_t phi : {1, 3}) {
    if (!(std::abs(numbers[phi]) <= 4 * kPi)) {
      lines.fail(
          std::string(phi == 1 ? "phi_i " : "phi_o ") + std::to_string(numbers[phi]) + " rad",
          "within two turns (radians)");
    }
  }
  return to_half_diff({direction(numbers[0], numbers[1]), direction(numbers[2], numbers[3])});
}

void append_measurement(const Lines& lines, const std::vector<double>& numbers,
                        std::vector<HalfDiff>& angles, std::vector<double>& values) {
  angles.push_back(read_angles(lines, numbers));
  for (std::size_t i = kAngles; i < numbers.size(); ++i) {
    if (!(std::isfinite(numbers[i]) && numbers[i] >= 0)) {
      lines.fail("value " + std::to_string(i - kAngles + 1) + " is " + std::to_string(numbers[i]),
                 "a finite reflectance in 1/sr, not negative");
    }
    values.push_back(numbers[i]);
  }
}

/// Value at a wavelength, linear between neighbours.
double at_band(const GoniometricList& list, Index row, double band) {
  const auto& w = list.wavelengths_nm;
  const auto above = std::lower_bound(w.begin(), w.end(), band);
  const Index upper = above - w.begin();
  if (*above == band) return list.f(row, upper);
  const double share = (band - w[upper - 1]) / (w[upper] - w[upper - 1]);
  return (1 - share) * list.f(row, upper - 1) + share * list.f(row, upper);
}

void check_bands(const GoniometricList& list, const std::array<double, 3>& bands) {
  for (const double band : bands) {
    if (band >= list.wavelengths_nm.front() && band <= list.wavelengths_nm.back()) continue;
    throw InputError("band " + std::to_string(band) + " nm", "outside the list's wavelengths",
                     std::to_string(list.wavelengths_nm.front()) + " to " +
                         std::to_string(list.wavelengths_nm.back()) + " nm");
  }
}

}  // namespace

GoniometricList parse_goniometric(std::string_view text, const std::string& name) {
  Lines lines(text, name);
  std::vector<double> numbers;
  GoniometricList list;
  bool more = lines.next(numbers);
  if (more && numbers.size() == 1) {
    list.wavelengths_nm = read_wavelengths(lines, numbers[0]);
    more = lines.next(numbers);
  }
  if (!more) lines.fail("no measurement", "lines of theta_i phi_i theta_o phi_o values...");
  if (numbers.size() <= kAngles) {
    lines.fail(std::to_string(numbers.size()) + " numbers", "four angles and values");
  }
  const std::size_t columns =
      list.wavelengths_nm.empty() ? numbers.size() - kAngles : list.wavelengths_nm.size();
  std::vector<double> values;
  for (; more; more = lines.next(numbers)) {
    if (numbers.size() != kAngles + columns) {
      lines.fail(std::to_string(numbers.size()) + " numbers",
                 std::to_string(kAngles + columns) + ": four angles and " +
                     std::to_string(columns) + " values");
    }
    append_measurement(lines, numbers, list.angles, values);
  }
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  list.f = Eigen::Map<const RowMajor>(values.data(), static_cast<Index>(list.angles.size()),
                                      static_cast<Index>(columns));
  return list;
}

GoniometricList read_goniometric(const std::filesystem::path& file) {
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(file, error);
  if (error) throw InputError(file, "cannot be read: " + error.message(), "a goniometric list");
  if (bytes > kMaxBytes) {
    throw InputError(file, std::to_string(bytes) + " bytes",
                     "at most " + std::to_string(kMaxBytes));
  }
  std::ifstream in(file, std::ios::binary);
  const std::string text(std::istreambuf_iterator<char>(in), {});
  if (!in || text.size() != bytes) throw InputError(file, "cannot be read", "a goniometric list");
  return parse_goniometric(text, file);
}

BinnedSamples to_samples(const GoniometricList& list, const std::array<double, 3>& bands_nm) {
  const bool spectral = !list.wavelengths_nm.empty();
  if (spectral) {
    check_bands(list, bands_nm);
  } else if (list.f.cols() != 1 && list.f.cols() != 3) {
    throw InputError("goniometric list", std::to_string(list.f.cols()) + " values per line",
                     "1 or 3, or wavelengths in the file's head");
  }
  BinnedSamples samples;
  samples.channels = spectral ? 3 : static_cast<int>(list.f.cols());
  samples.bins.reserve(list.angles.size());
  for (Index row = 0; row < list.f.rows(); ++row) {
    Bin bin;
    bin.id = static_cast<int>(row);
    bin.light = 1;
    bin.angles = list.angles[static_cast<std::size_t>(row)];
    bin.pixels = 1;
    for (int channel = 0; channel < samples.channels; ++channel) {
      bin.f[channel] = spectral ? at_band(list, row, bands_nm[static_cast<std::size_t>(channel)])
                                : list.f(row, channel);
    }
    samples.bins.push_back(bin);
  }
  return samples;
}

std::vector<std::size_t> choose_directions(const Basis& basis,
                                           const std::vector<HalfDiff>& candidates, int count,
                                           DirectionCriterion criterion) {
  if (count < 1 || static_cast<std::size_t>(count) > candidates.size()) {
    throw InputError("directions to choose", std::to_string(count),
                     "1 to " + std::to_string(candidates.size()));
  }
  const Eigen::MatrixXd q = basis.rows(candidates).q;
  // Posterior covariance of the weights over the error variance: (Q^T Q + eta I)^-1, updated by
  // one row at a time. Observing q_j lowers the variance at q_i by (q_i P q_j)^2 / (1 + q_j P q_j).
  Eigen::MatrixXd p = Eigen::MatrixXd::Identity(q.cols(), q.cols()) / kRidgeEta;
  const Eigen::MatrixXd all = q.transpose() * q;
  std::vector<std::size_t> chosen;
  std::vector<bool> taken(candidates.size(), false);
  while (chosen.size() < static_cast<std::size_t>(count)) {
    const Eigen::MatrixXd qp = q * p;
    const Eigen::ArrayXd own = qp.cwiseProduct(q).rowwise().sum().array();
    Eigen::ArrayXd gain = own;
    if (criterion == DirectionCriterion::expected_error)
      gain = (qp * all).cwiseProduct(qp).rowwise().sum().array() / (1 + own);
    for (std::size_t i = 0; i < taken.size(); ++i) {
      if (taken[i]) gain[static_cast<Index>(i)] = -1;
    }
    Index best = 0;
    gain.maxCoeff(&best);
    const Eigen::RowVectorXd row = qp.row(best);
    p -= row.transpose() * row / (1 + own[best]);
    taken[static_cast<std::size_t>(best)] = true;
    chosen.push_back(static_cast<std::size_t>(best));
  }
  return chosen;
}

}  // namespace brdfgate
