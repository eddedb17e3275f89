#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <span>

#include "catch.hpp"
#include "model/analytic.hpp"
#include "model/mapped_file.hpp"
#include "model/merl.hpp"
#include "model/reconstruction.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

constexpr double kPi = std::numbers::pi;

template <typename F>
MerlTable tabulated(F&& f) {
  MerlTable table;
  for (int h = 0; h < MerlFormat::kThetaH; ++h) {
    for (int d = 0; d < MerlFormat::kThetaD; ++d) {
      for (int p = 0; p < MerlFormat::kPhiD; ++p) {
        const HalfDiff at = MerlFormat::centre(h, d, p);
        if (!cosines(at).above_horizon()) continue;
        const Rgb v = f(at);
        for (std::size_t channel = 0; channel < 3; ++channel)
          table.f[channel][MerlFormat::cell(h, d, p)] = v[static_cast<Eigen::Index>(channel)];
      }
    }
  }
  return table;
}

/// A smooth table whose value depends on all three angles, also at the poles' rings.
Rgb smooth(const HalfDiff& a) {
  const double v = 0.1 + std::cos(a.theta_d) + 0.3 * std::sin(a.theta_h) * std::cos(2 * a.phi_d);
  return {v, 2 * v, 0.5 * v};
}

/// The smooth table on disk: written once for the tests that only read.
struct SmoothFile {
  TempDir dir;
  std::filesystem::path file = dir / "smooth.binary";
  SmoothFile() { write_merl(file, tabulated(smooth)); }
};
const std::filesystem::path& smooth_file() {
  static const SmoothFile made;
  return made.file;
}

std::string bytes_of(const std::filesystem::path& file) {
  const MappedFile mapped(file);
  return {reinterpret_cast<const char*>(mapped.bytes().data()), mapped.bytes().size()};
}

/// Puts a double into one cell of a file's bytes.
void set_cell(std::string& bytes, int channel, std::size_t cell, double value) {
  std::memcpy(bytes.data() + 12 + (channel * MerlFormat::kCells + cell) * 8, &value, 8);
}

}  // namespace

TEST_CASE("a MERL file gives back its cells at their centres") {
  const auto brdf = MerlBrdf::open(smooth_file());
  for (const auto& [h, d, p] : {std::array{0, 0, 0}, std::array{3, 40, 179}, std::array{60, 20, 91},
                                std::array{89, 0, 90}}) {
    const HalfDiff at = MerlFormat::centre(h, d, p);
    const Rgb expected = smooth(at);
    for (int channel = 0; channel < 3; ++channel) {
      CHECK(brdf->cell(channel, MerlFormat::cell(h, d, p)) == Approx(expected[channel]));
      CHECK(brdf->table(at)[channel] == Approx(expected[channel]).epsilon(1e-9));
      CHECK(brdf->eval(at)[channel] == Approx(expected[channel]).epsilon(1e-9));
    }
  }
}

TEST_CASE("a cell on disk is f over the format's colour scale") {
  // Matusik et al. 2003, the database's reader: f = value * {1, 1.15, 1.66} / 1500.
  const std::string bytes = bytes_of(smooth_file());
  CHECK(bytes.size() == 12 + 3 * 90 * 90 * 180 * 8);
  const std::size_t cell = (std::size_t{10} * 90 + 20) * 180 + 30;
  const double expected =
      smooth({std::pow(10.5 / 90, 2) * kPi / 2, 20.5 * kPi / 180, 30.5 * kPi / 180})[2];
  double on_disk = 0;
  std::memcpy(&on_disk, bytes.data() + 12 + (2 * std::size_t{1458000} + cell) * 8, 8);
  CHECK(on_disk * 1.66 / 1500 == Approx(expected));
}

TEST_CASE("between cell centres a MERL table is linear in the axis indices") {
  const auto brdf = MerlBrdf::open(smooth_file());
  const auto at_index = [](double h, double d, double p) {
    return HalfDiff{std::pow(h / 90, 2) * kPi / 2, d * kPi / 180, p * kPi / 180};
  };
  const double low = brdf->table(at_index(20.5, 30.5, 40.5))[0];
  CHECK(brdf->table(at_index(20.75, 30.5, 40.5))[0] ==
        Approx(0.75 * low + 0.25 * brdf->table(at_index(21.5, 30.5, 40.5))[0]));
  CHECK(brdf->table(at_index(20.5, 30.6, 40.5))[0] ==
        Approx(0.9 * low + 0.1 * brdf->table(at_index(20.5, 31.5, 40.5))[0]));
  CHECK(brdf->table(at_index(20.5, 30.5, 41.0))[0] ==
        Approx(0.5 * low + 0.5 * brdf->table(at_index(20.5, 30.5, 41.5))[0]));
}

TEST_CASE("phi_d is periodic over pi in a MERL table") {
  const auto brdf = MerlBrdf::open(smooth_file());
  for (const double phi : {0.0, 0.003, 1.0, 3.14}) {
    const double there = brdf->table({0.8, 0.4, phi})[1];
    CHECK(brdf->table({0.8, 0.4, phi + kPi})[1] == Approx(there));
    CHECK(brdf->table({0.8, 0.4, phi - kPi})[1] == Approx(there));
  }
  // Across the seam: between the last cell and the first.
  const double last = brdf->table({0.8, 0.4, 179.5 * kPi / 180})[0];
  const double first = brdf->table({0.8, 0.4, 0.5 * kPi / 180})[0];
  CHECK(brdf->table({0.8, 0.4, 0.0})[0] == Approx((last + first) / 2));
}

TEST_CASE("where phi_d is undefined a MERL table does not depend on it") {
  // A table that varies with phi_d even next to the poles, as noisy measurements do.
  const TempDir dir;
  write_merl(dir / "a.binary",
             tabulated([](const HalfDiff& a) { return Rgb::Constant(1 + std::sin(5 * a.phi_d)); }));
  const auto brdf = MerlBrdf::open(dir / "a.binary");
  for (const double theta : {0.0, 0.3, 1.2}) {
    const double at_peak = brdf->table({0, theta, 0})[0];
    const double at_retro = brdf->table({theta, 0, 0})[0];
    for (const double phi : {0.1, 1.0, 2.0, 3.0}) {
      CHECK(brdf->table({0, theta, phi})[0] == Approx(at_peak));
      CHECK(brdf->table({theta, 0, phi})[0] == Approx(at_retro));
      // And it is continuous there.
      CHECK(brdf->table({1e-14, theta, phi})[0] == Approx(at_peak).epsilon(1e-2));
      CHECK(brdf->table({theta, 1e-8, phi})[0] == Approx(at_retro).epsilon(1e-4));
    }
  }
}

TEST_CASE("missing neighbours are left out and their weights shared among the others") {
  MerlTable table = tabulated([](const HalfDiff&) { return Rgb::Constant(0.5); });
  // Two of the eight neighbours are missing, and for one channel all of them up to theta_h = 0.
  table.f[0][MerlFormat::cell(20, 30, 40)] = -1;
  table.f[0][MerlFormat::cell(21, 30, 40)] = -1;
  for (int h = 15; h < 90; ++h) {
    for (int p = 0; p < 180; ++p) {
      for (int d = 29; d < 33; ++d)
        table.f[1][MerlFormat::cell(h, d, p)] = -1;
    }
  }
  for (int p = 0; p < 180; ++p) {
    for (int d = 29; d < 33; ++d)
      table.f[1][MerlFormat::cell(14, d, p)] = 0.25;
  }
  const TempDir dir;
  write_merl(dir / "a.binary", table);
  const auto brdf = MerlBrdf::open(dir / "a.binary");
  const HalfDiff at{std::pow(21.0 / 90, 2) * kPi / 2, 31.0 * kPi / 180, 41.0 * kPi / 180};
  const Rgb f = brdf->table(at);
  CHECK(f[0] == Approx(0.5));
  CHECK(f[1] == Approx(0.25));  // the nearest valid cell toward the peak
  CHECK(f[2] == Approx(0.5));
  CHECK(brdf->cell(0, MerlFormat::cell(20, 30, 40)) < 0);
}

TEST_CASE("no angle makes a MERL lookup fail") {
  const auto brdf = MerlBrdf::open(smooth_file());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double a : {-1.0, 0.0, 1.57, kPi / 2, 3.0, 1e300, nan}) {
    for (const double b : {-1.0, 0.0, 1.57, kPi / 2, 3.0, 1e300, nan}) {
      const Rgb f = brdf->table({a, b, a});
      CHECK((f.isFinite().all() && (f >= 0).all()));
    }
  }
}

TEST_CASE("the diffuse part of a table is the minimum over theta_h below 60 degrees") {
  // Falls with theta_h down to a floor that depends on theta_d, and falls further beyond 60
  // degrees.
  const auto f = [](const HalfDiff& a) {
    const double floor = 0.05 + 0.1 * a.theta_d;
    const double beyond = a.theta_h < kPi / 3 ? 0.0 : -0.04;
    return Rgb::Constant(floor + std::exp(-40 * a.theta_h) + beyond);
  };
  const TempDir dir;
  write_merl(dir / "a.binary", tabulated(f));
  const auto brdf = MerlBrdf::open(dir / "a.binary");
  for (const double deg : {0.5, 10.5, 20.0}) {
    CHECK(brdf->diffuse(deg * kPi / 180)[0] == Approx(0.05 + 0.1 * deg * kPi / 180).epsilon(1e-4));
  }
  const HalfDiff at{0.1, 0.3, 1.0};
  CHECK((brdf->specular(at) + brdf->diffuse(0.3))[0] == Approx(brdf->table(at)[0]));
  CHECK(brdf->specular({1.2, 0.2, 1.0})[0] < 0);
}

TEST_CASE("an unusable MERL file is refused with file and reason") {
  const TempDir dir;
  const auto refusal = [&](const char* name, const std::string& bytes) {
    const auto file = dir.write(name, bytes);
    const std::string error = input_error([&] { return MerlBrdf::open(file); });
    CHECK(contains(error, name));
    return error;
  };
  CHECK(contains(input_error([&] { return MerlBrdf::open(dir / "none.binary"); }), "none.binary"));
  CHECK(contains(input_error([&] { return MerlBrdf::open(dir.path()); }), "regular file"));
  CHECK(contains(refusal("empty.binary", ""), "0 bytes"));
  const std::string good = bytes_of(smooth_file());
  CHECK(contains(refusal("short.binary", good.substr(0, good.size() - 8)), "truncated"));
  CHECK(contains(refusal("long.binary", good + "x"), "too long"));
  std::string other = good;
  other[0] = 91;
  CHECK(contains(refusal("dims.binary", other), "91 x 90 x 180"));
  std::string nan = good;
  set_cell(nan, 1, MerlFormat::cell(2, 3, 4), std::nan(""));
  CHECK(contains(refusal("nan.binary", nan), "channel 1, cell (2, 3, 4)"));
  std::string negative = good;
  for (std::size_t i = 0; i < MerlFormat::kCells; ++i)
    set_cell(negative, 2, i, -0.5);
  CHECK(contains(refusal("negative.binary", negative), "channel 2 has no valid cell"));
  // Below the horizon anything may stand.
  std::string below = good;
  REQUIRE_FALSE(cosines(MerlFormat::centre(89, 89, 0)).above_horizon());
  set_cell(below, 0, MerlFormat::cell(89, 89, 0), std::nan(""));
  CHECK_NOTHROW(MerlBrdf::open(dir.write("below.binary", below)));
}

TEST_CASE("write_merl leaves nothing behind where it cannot write") {
  const TempDir dir;
  CHECK(
      contains(input_error([&] { write_merl(dir / "no" / "a.binary", MerlTable()); }), "a.binary"));
  MerlTable wrong;
  wrong.f[1].resize(7);
  CHECK(contains(input_error([&] { write_merl(dir / "b.binary", wrong); }), "7 cells"));
  CHECK(std::filesystem::is_empty(dir.path()));
}

TEST_CASE("compare is zero for equal files and the logarithm of a factor for bright ones") {
  const TempDir dir;
  write_merl(dir / "a.binary", tabulated([](const HalfDiff&) { return Rgb(100, 200, 300); }));
  MerlTable scaled = tabulated([](const HalfDiff&) { return Rgb(200, 200, 150); });
  write_merl(dir / "b.binary", scaled);
  const auto a = MerlBrdf::open(dir / "a.binary");
  const auto b = MerlBrdf::open(dir / "b.binary");
  CHECK(compare(*a, *a).mapped_rms == 0);
  CHECK(compare(*a, *a).missing_cells == 0);
  const BrdfDifference d = compare(*a, *b);
  // f w is at least 100 * 0.0004 here, so epsilon takes at most 2.5 % off.
  CHECK(d.mapped_rms_per_channel[0] == Approx(std::log(2)).epsilon(0.005));
  CHECK(d.mapped_rms_per_channel[1] == 0);
  CHECK(d.mapped_rms_per_channel[2] == Approx(std::log(2)).epsilon(0.005));
  CHECK(d.mapped_rms == Approx((d.mapped_rms_per_channel[0] + d.mapped_rms_per_channel[2]) / 3));
  CHECK(compare(*b, *a).mapped_rms == Approx(d.mapped_rms));
}

TEST_CASE("a missing cell counts as an error of five") {
  const auto half = [](const HalfDiff&) { return Rgb::Constant(0.5); };
  MerlTable table = tabulated(half);
  std::size_t counted = 0;
  for (int h = 0; h < 90; ++h) {
    for (int d = 0; d < 90; ++d) {
      for (int p = 0; p < 180; ++p)
        counted += cosines(MerlFormat::centre(h, d, p)).above_horizon(0.02) ? 1 : 0;
    }
  }
  const TempDir dir;
  write_merl(dir / "a.binary", table);
  for (int p = 0; p < 10; ++p)
    table.f[1][MerlFormat::cell(5, 5, p)] = -1;
  write_merl(dir / "b.binary", table);
  const BrdfDifference d =
      compare(*MerlBrdf::open(dir / "a.binary"), *MerlBrdf::open(dir / "b.binary"));
  CHECK(d.missing_cells == 10);
  CHECK(d.mapped_rms_per_channel[0] == 0);
  CHECK(d.mapped_rms_per_channel[1] == Approx(5 * std::sqrt(10.0 / static_cast<double>(counted))));
}
