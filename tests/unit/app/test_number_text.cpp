#include <string>

#include "app/number_text.hpp"
#include "catch.hpp"

using namespace brdfgate;

TEST_CASE("A number is the whole text, and finite") {
  struct Row {
    std::string text;
    std::optional<double> number;
  };
  const auto row = GENERATE(values<Row>({{"20", 20.0},
                                         {"-0.5", -0.5},
                                         {"1e3", 1000.0},
                                         {"", std::nullopt},
                                         {"20,180", std::nullopt},
                                         {"20 ", std::nullopt},
                                         {"20deg", std::nullopt},
                                         {"nan", std::nullopt},
                                         {"inf", std::nullopt},
                                         {"1e999", std::nullopt}}));
  CAPTURE(row.text);
  CHECK(finite_number(row.text) == row.number);
}
