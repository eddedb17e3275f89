#include "app/white_factor_file.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

TEST_CASE("A plate's radiance factor is read from its certificate's table") {
  const TempDir dir;
  const auto file = dir.write("plate 7.csv",
                              "# certificate 7\nlight,theta_h_deg,factor\n1,0,1.08\n2,30,0.99\n"
                              "1,10,1.02\n");
  const WhiteFactorTable table = read_white_factor(file, 2);
  CHECK(table.name == "plate 7.csv");
  CHECK(table.factor(0, 5 * EIGEN_PI / 180) == Approx(1.05));
  CHECK(table.factor(1, 0) == 0.99);
}

TEST_CASE("A table of radiance factors that cannot be right is refused by line") {
  const TempDir dir;
  const auto refusal = [&](const std::string& rows) {
    const auto file = dir.write("a.csv", "light,theta_h_deg,factor\n" + rows);
    return input_error([&] { return read_white_factor(file, 2); });
  };
  CHECK(contains(refusal("0,0,1\n"), "a.csv:2: light 0; expected 1 to 2"));
  CHECK(contains(refusal("1,0,1\n3,0,1\n"), "a.csv:3: light 3"));
  CHECK(contains(refusal("1,0,1\n"), "no figure for light 2"));
  CHECK(contains(refusal("1,5,1\n1,5,1\n2,0,1\n"), "a.csv:3: theta_h_deg does not rise"));
  CHECK(contains(refusal("1,91,1\n"), "a.csv:2: theta_h_deg 91"));
  CHECK(contains(refusal("1,0,99\n"), "factor 99; expected 0.5 to 2"));
  CHECK(contains(refusal("1,0\n"), "a.csv:2: '' is no number"));
}
