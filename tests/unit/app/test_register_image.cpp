#include <cmath>
#include <limits>
#include <stdexcept>

#include "app/plc/register_image.hpp"
#include "app/plc/result_blocks.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/plc_part.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {
RegisterImage fresh(WordOrder order = WordOrder::abcd) {
  return {RegisterMap::built_in(), order};
}
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
}  // namespace

TEST_CASE("32-bit values lie in two words, in either order") {
  using Words = std::array<std::uint16_t, 2>;
  CHECK(split_u32(0x01020304, WordOrder::abcd) == Words{0x0102, 0x0304});
  CHECK(split_u32(0x01020304, WordOrder::cdab) == Words{0x0304, 0x0102});
  for (const WordOrder order : {WordOrder::abcd, WordOrder::cdab}) {
    for (const std::uint32_t value : {0u, 1u, 0xFFFFu, 0x10000u, 0x80000001u, 0xFFFFFFFFu}) {
      const auto words = split_u32(value, order);
      CHECK(join_u32(words[0], words[1], order) == value);
    }
  }
}

TEST_CASE("Floats have the bits of IEEE 754") {
  struct Row {
    double value;
    std::uint16_t high, low;
  };
  // Known encodings; 123456.0 = 0x47F12000 is the usual example of Modbus float tables.
  for (const Row& row : {Row{1.0, 0x3F80, 0x0000}, Row{-2.0, 0xC000, 0x0000},
                         Row{123456.0, 0x47F1, 0x2000}, Row{0.1, 0x3DCC, 0xCCCD}, Row{0.0, 0, 0}}) {
    for (const WordOrder order : {WordOrder::abcd, WordOrder::cdab}) {
      RegisterImage image = fresh(order);
      image.put_real("result.t2_ratio", row.value);
      const bool high_first = order == WordOrder::abcd;
      CHECK(image.words()[110] == (high_first ? row.high : row.low));
      CHECK(image.words()[111] == (high_first ? row.low : row.high));
      CHECK(image.get_real("result.t2_ratio") == static_cast<float>(row.value));
    }
  }
}

TEST_CASE("What is not a number never goes out, and infinities become the largest float") {
  CHECK(publishable(kNan) == 0.0F);
  CHECK(publishable(-kNan) == 0.0F);
  CHECK(publishable(kInfinity) == std::numeric_limits<float>::max());
  CHECK(publishable(-1e300) == -std::numeric_limits<float>::max());
  CHECK(publishable(0.5) == 0.5F);
}

TEST_CASE("Counts stop at what their registers hold") {
  RegisterImage image = fresh();
  image.put("result.cycle_ms", 65535);
  CHECK(image.get("result.cycle_ms") == 65535);
  image.put("result.cycle_ms", 70000);
  CHECK(image.get("result.cycle_ms") == 65535);
  image.put("counters.inspected", 0x1FFFFFFFFull);
  CHECK(image.get("counters.inspected") == 0xFFFFFFFFu);
}

TEST_CASE("Fields are written at their own addresses and nowhere else") {
  RegisterImage image = fresh();
  image.put("cluster.seq_tail", 0xABCD1234, 3);
  image.put_real("cluster.weights", 1.0, 7, 23);
  for (std::size_t i = 0; i < image.words().size(); ++i) {
    const std::uint16_t expected = i == 574 ? 0xABCD : i == 575 ? 0x1234 : i == 972 ? 0x3F80 : 0;
    REQUIRE(image.words()[i] == expected);
  }
}

TEST_CASE("Wrong names, elements and types are programming errors that are caught") {
  RegisterImage image = fresh();
  CHECK(contains(input_error([&] {
                   image.put("result.nothing", 1);
                   return 0;
                 }),
                 "result.nothing"));
  CHECK_THROWS_AS(image.put("station.config_hash", 1, 0, 4), std::out_of_range);
  CHECK_THROWS_AS(image.put_real("result.verdict", 1), std::logic_error);
  CHECK_THROWS_AS(image.put("result.t2_ratio", 1), std::logic_error);
}

TEST_CASE("A part's values arrive in result and cluster blocks, in both word orders") {
  for (const WordOrder order : {WordOrder::abcd, WordOrder::cdab}) {
    RegisterImage image = fresh(order);
    const PartResult part = scripted_part(Verdict::reject, 8);
    write_part(image, part, part.verdict);
    write_head(image, {77, 0xCAFE0001, 12, ResultState::completed, 65000, 70000, 135000});
    CHECK(image.get("result.seq_head") == 77);
    CHECK(image.get("result.seq_tail") == 77);
    CHECK(image.get("result.trigger_id") == 0xCAFE0001);
    CHECK(image.get("result.result_id") == 12);
    CHECK(image.get("result.result_state") == 1);
    CHECK(image.get("result.verdict") == 2);
    CHECK(image.get("result.reason_bits") == 0x41);
    CHECK(image.get("result.worst_cluster") == 1);
    CHECK(image.get_real("result.t2_ratio") == 0.875F);
    CHECK(image.get_real("result.spe_ratio") == 0.625F);
    CHECK(image.get_real("result.tilt_x_deg") == 0.25F);
    CHECK(image.get_real("result.tilt_y_deg") == -0.5F);
    CHECK(image.get_real("result.ambient") == 0.0078125F);
    CHECK(image.get("result.acquisition_ms") == 65000);
    CHECK(image.get("result.processing_ms") == 65535);
    CHECK(image.get("result.cycle_ms") == 65535);
    CHECK(image.get("result.defects") == 3);
    for (int n = 0; n < 8; ++n) {
      INFO(n);
      CHECK(image.get("cluster.seq_head", n) == 77);
      CHECK(image.get("cluster.seq_tail", n) == 77);
      CHECK(image.get("cluster.valid_bits", n) == 0x3F);
      CHECK(image.get("cluster.pixels_16", n) == static_cast<std::uint32_t>(1000 + n));
      CHECK(image.get_real("cluster.area_share", n) == 0.125F);
      CHECK(image.get_real("cluster.t2", n) == 2.5F + n);
      CHECK(image.get_real("cluster.spe", n) == 0.75F + n);
      CHECK(image.get_real("cluster.gloss_20", n) == 20.5F + n);
      CHECK(image.get_real("cluster.gloss_60", n) == 60.5F + n);
      CHECK(image.get_real("cluster.gloss_85", n) == 85.5F + n);
      CHECK(image.get_real("cluster.lightness", n) == 50.5F + n);
      CHECK(image.get_real("cluster.a_star", n) == -3.25F);
      CHECK(image.get_real("cluster.b_star", n) == 7.75F);
      CHECK(image.get_real("cluster.delta_e00", n) == 0.5F);
      CHECK(image.get_real("cluster.weight_uncertainty", n) == 0.25F);
      for (int i = 0; i < 24; ++i) {
        const int channel = i / 8;
        const auto expected = static_cast<float>(n + channel) + static_cast<float>(i % 8 + 1) / 16;
        CHECK(image.get_real("cluster.weights", n, i) == expected);
      }
    }
  }
}

TEST_CASE("Every register of the result and cluster tables is filled by a full part") {
  RegisterImage image = fresh();
  const PartResult part = scripted_part(Verdict::reject, 8);
  write_part(image, part, part.verdict);
  write_head(image, {77, 1, 12, ResultState::completed, 1, 1, 1});
  for (const RegisterRow& row : image.map().rows()) {
    if (row.block != "result" && row.block != "cluster") continue;
    INFO(row.block << "." << row.name);
    for (int element = 0; element < row.count; ++element) {
      const bool zero = row.type == RegisterType::f32
                            ? image.get_real(row.block + "." + row.name, 0, element) == 0
                            : image.get(row.block + "." + row.name, 0, element) == 0;
      CHECK_FALSE(zero);
    }
  }
}

TEST_CASE("What is not valid is zero") {
  PartResult part = scripted_part(Verdict::not_judged, 1);
  ClusterResult& cluster = part.clusters[0];
  cluster.valid = {};
  cluster.weights(0, 0) = kNan;
  cluster.lab[0] = kNan;
  RegisterImage image = fresh();
  write_part(image, part, part.verdict);
  CHECK(image.get("cluster.valid_bits") == 1);
  for (int i = 0; i < 24; ++i)
    CHECK(image.get_real("cluster.weights", 0, i) == 0);
  for (const char* key :
       {"cluster.gloss_20", "cluster.gloss_60", "cluster.gloss_85", "cluster.lightness",
        "cluster.a_star", "cluster.b_star", "cluster.delta_e00", "cluster.weight_uncertainty"}) {
    CHECK(image.get_real(key) == 0);
  }
}

TEST_CASE("No value, however odd, puts a NaN or infinity on the wire") {
  for (const double odd : {kNan, kInfinity, -kInfinity}) {
    PartResult part = scripted_part(Verdict::reject, 1);
    part.t2_ratio = part.spe_ratio = part.ambient = odd;
    part.tilt_deg = {odd, odd};
    ClusterResult& c = part.clusters[0];
    c.area_share = c.deviation.t2 = c.deviation.spe = c.delta_e00 = odd;
    c.gloss_gu = {odd, odd, odd};
    c.lab.setConstant(odd);
    c.weights.setConstant(odd);
    c.weight_sigmas.setConstant(odd);
    RegisterImage image = fresh();
    write_part(image, part, part.verdict);
    for (const RegisterRow& row : image.map().rows()) {
      if (row.type != RegisterType::f32) continue;
      for (int i = 0; i < row.count; ++i) {
        REQUIRE(std::isfinite(image.get_real(row.block + "." + row.name, 0, i)));
      }
    }
  }
}

TEST_CASE("Fewer components or one channel leave the rest zero; more are cut at eight") {
  PartResult part = scripted_part(Verdict::pass, 1);
  part.clusters[0] = scripted_cluster(0, 5, 1);
  part.clusters[0].pixels = 16 * 70000;
  RegisterImage image = fresh();
  write_part(image, part, part.verdict);
  for (int i = 0; i < 24; ++i) {
    CHECK((image.get_real("cluster.weights", 0, i) != 0) == (i < 5));
  }
  CHECK(image.get("cluster.pixels_16") == 65535);
  CHECK(image.get_real("cluster.weight_uncertainty") == 0.25F);
}

TEST_CASE("A cluster beyond the eighth, or a nonsense index, is not written anywhere") {
  PartResult part = scripted_part(Verdict::pass, 1);
  part.clusters[0].index = 8;
  part.clusters.push_back(scripted_cluster(-1));
  RegisterImage image = fresh();
  write_part(image, part, part.verdict);
  for (std::size_t i = 126; i < image.words().size(); ++i)
    REQUIRE(image.words()[i] == 0);
}

TEST_CASE("No verdict, or a pass with reasons against it, is published as not judged") {
  PartResult part = scripted_part(Verdict::pass, 1);
  CHECK(publishable_verdict(part) == Verdict::pass);
  part.reason_bits = bit(Reason::spe);
  CHECK(publishable_verdict(part) == Verdict::not_judged);
  part = scripted_part(Verdict::none, 1);
  CHECK(publishable_verdict(part) == Verdict::not_judged);
  CHECK(publishable_verdict(scripted_part(Verdict::reject, 1)) == Verdict::reject);
}
