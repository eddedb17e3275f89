#include <array>
#include <random>
#include <set>

#include "catch.hpp"
#include "config/station_config.hpp"
#include "config/yaml_reader.hpp"
#include "model/hash.hpp"
#include "support/input_error.hpp"
#include "support/mutate.hpp"
#include "support/shipped.hpp"
#include "support/station_text.hpp"
#include "support/temp_dir.hpp"

using brdfgate::read_station_config;
using brdfgate::StationConfig;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::place_of;
using brdfgate::test::replaced;
using brdfgate::test::shipped_file;
using brdfgate::test::shipped_text;
using brdfgate::test::TempDir;

namespace {

std::string sample() {
  return brdfgate::test::kStationText;
}

StationConfig read_text(const TempDir& dir, const std::string& text) {
  return read_station_config(dir.write("station.yaml", text));
}

struct BadStation {
  std::string from;   ///< what the shipped file says (once)
  std::string to;     ///< instead
  std::string value;  ///< the text of `to` at which the complaint must be placed
  std::string path;
  std::string what;
};

}  // namespace

TEST_CASE("The shipped station loads and survives its own print") {
  const StationConfig config = read_station_config(shipped_file("station.yaml"));
  const TempDir dir;
  CHECK(to_yaml(read_text(dir, to_yaml(config))) == to_yaml(config));
  for (const auto& scene : config.camera.scenes) {
    CAPTURE(scene);
    CHECK(std::filesystem::is_regular_file(scene));
  }
  CHECK(config.hash == brdfgate::sha256_hex(shipped_text("station.yaml")));
}

TEST_CASE("A station is read with its units turned to SI and its paths resolved") {
  const TempDir dir;
  const StationConfig config = read_text(dir, sample());
  CHECK(config.name == "simulated bench");
  CHECK(config.camera.sensor.width == 1456);
  CHECK(config.camera.sensor.mosaic == brdfgate::Mosaic::rggb);
  CHECK(config.camera.bracket_ms == std::vector<double>{0.03, 0.4, 5, 60});
  CHECK(config.camera.scenes.front() == dir / "scenes/good.yaml");
  CHECK(config.rig.camera_m == 0.18);
  REQUIRE(config.rig.lights.size() == 2);
  CHECK(config.rig.lights[0].phi_deg == 180);
  CHECK(config.rig.lights[1].distance_m == 0.3);
  CHECK(config.simulator.line_time_s == Approx(14.8e-6).epsilon(1e-15));
  CHECK(config.simulator.led_radius_m == 0.0005);
  CHECK(config.simulator.white_exposure_s == 0.008);
  CHECK(config.simulator.sensor == config.camera.sensor);
  CHECK(config.simulator.noise.gain_dn_per_e == 0.0963);
  CHECK(config.simulator.fixture_albedo[2] == 0.4);
  CHECK(config.simulator.geometry.lights_W.size() == 2);
  CHECK(config.simulator.geometry.camera.position().norm() == Approx(0.18));
  CHECK(config.inspection.colour == brdfgate::ColourSource::linear_srgb_d65);
  CHECK(config.judge.min_bins == 20);
  CHECK(config.plc.word_order == brdfgate::WordOrder::abcd);
  CHECK(config.files.basis == dir / "basis/merl.basis");
  CHECK(config.hash == brdfgate::sha256_hex(sample()));
  CHECK(config.station_hash.size() == 64);
}

TEST_CASE("Every rule of the station file complains at its place with its path") {
  const auto bad = GENERATE(values<BadStation>({
      {"station: simulated bench", "station: ''", "''", "station", "1 to 100 printable"},
      {"backend: simulated", "backend: simulate", "simulate\n", "camera.backend",
       "did you mean 'simulated'?"},
      {"width: 1456", "width: 1455", "1455", "camera.sensor.width", "even number"},
      {"width: 1456", "width: 1", "1\n", "camera.sensor.width", "2..16384"},
      {"bits: 10", "bits: 7", "7", "camera.sensor.bits", "8..16"},
      {"bits: 10", "bits: 9", "1023", "camera.sensor.full_well_dn", "at most 511"},
      {"mosaic: rggb", "mosaic: rgbg", "rgbg", "camera.sensor.mosaic", "did you mean"},
      {"black_level_dn: 60", "black_level_dn: 1023", "1023", "camera.sensor.black_level_dn",
       "below full_well_dn (1023)"},
      {"full_well_dn: 1023", "full_well_dn: 0", "0\n", "camera.sensor.full_well_dn", "above 0"},
      {"gain_dn_per_electron: 0.0963", "gain_dn_per_electron: 0", "0\n",
       "camera.sensor.gain_dn_per_electron", "above 0"},
      {"read_noise_dn: 0.3", "read_noise_dn: 0.3\n    response: gamma", "gamma",
       "camera.sensor.response", "one of linear, tone_curve"},
      {"bits: 10\n    mosaic: rggb", "bits: 12\n    response: tone_curve\n    mosaic: rggb",
       "tone_curve", "camera.sensor.response", "at most 10 bits"},
      {"plc:", "upkeep: {grace_days: -1}\nplc:", "-1}", "upkeep.grace_days", "0..36500"},
      {"read_noise_dn: 0.3", "read_noise_dn: -1", "-1", "camera.sensor.read_noise_dn", "0..1000"},
      {"[0.03, 0.4, 5, 60]", "[0.03, 5, 5, 60]", "5, 60", "camera.bracket_ms[2]",
       "5 after 5; expected rising exposures"},
      {"[0.03, 0.4, 5, 60]", "[]", "[]", "camera.bracket_ms", "0 exposures; expected 1 to 16"},
      {"ambient_ms: [5, 60]", "ambient_ms: [0]", "0]", "camera.ambient_ms[0]", "above 0"},
      {"gain: 1\n", "gain: 0.5\n", "0.5\n", "camera.gain", "1..64"},
      {"frame_timeout_ms: 1000", "frame_timeout_ms: 60", "60\n", "camera.frame_timeout_ms",
       "before the longest exposure; expected more than 60"},
      {"seed: 1", "seed: -1", "-1\n", "camera.seed", "whole number"},
      {"camera: {theta_deg: 55", "camera: {theta_deg: 90", "90", "rig.camera.theta_deg", "0..85"},
      {"field_of_view_deg: 25", "field_of_view_deg: 0", "0\n", "rig.field_of_view_deg", "above 0"},
      {"    - {theta_deg: 20, phi_deg: 0, distance_mm: 300}\n", "", "- {theta_deg: 55",
       "rig.lights", "1 lights; expected 2: the mirror light"},
      {"- {theta_deg: 55, phi_deg: 180,", "- {theta_deg: 55, phi_deg: 90,", "{theta_deg: 55, phi",
       "rig.lights[0]", "the mirror light"},
      {"- {theta_deg: 20, phi_deg: 0,", "- {theta_deg: 50, phi_deg: 180,", "{theta_deg: 50, phi",
       "rig.lights[1]", "the diffuse light"},
      {"full_well_e: 10000", "full_well_e: 0", "0\n", "simulator.full_well_e", "above 0"},
      {"white_exposure_ms: 8", "white_exposure_ms: 8\n  light_rise_ms: -1", "-1\n",
       "simulator.light_rise_ms", "0..1000"},
      {"vignetting: 0.15", "vignetting: 1", "1\n", "simulator.vignetting", "0..0.9"},
      {"region_mm: [90, 90]", "region_mm: [90]", "[90]", "inspection.region_mm", "1 values"},
      {"region_mm: [90, 90]", "region_mm: [90, 290]", "[90, 290]", "inspection.region_mm",
       "90 x 290 mm reaches beyond the camera's view; expected at most about"},
      {"region_mm: [90, 90]", "region_mm: [900, 90]", "[900, 90]", "inspection.region_mm",
       "beyond the camera's view"},
      {"albedo: [0.01,", "albedo: [1.01,", "1.01", "inspection.fixture.albedo[0]", "0..1"},
      {"tolerance: 0.25}", "tolerance: 0}", "0}", "inspection.fixture.tolerance", "above 0"},
      {"max_clusters: 8", "max_clusters: 9", "9\n", "inspection.max_clusters", "1..8"},
      {"method: ridge", "method: lasso", "lasso", "inspection.method", "expected one of gp, ridge"},
      {"eta: 40", "eta: 0", "0\n", "inspection.eta", "above 0"},
      {"mosaic: rggb", "mosaic: mono", "linear_srgb_d65", "inspection.colour",
       "a mono sensor measures no colour"},
      {"false_reject_rate: 0.001", "false_reject_rate: 0.5", "0.5\n", "judge.false_reject_rate",
       "above 0 and below 0.5"},
      {"change_floor: 0.002", "change_floor: 0", "0\n", "judge.change_floor", "above 0"},
      {"min_coverage: 0.25", "min_coverage: 25", "25", "judge.min_coverage", "0..1"},
      {"min_coverage: 0.25", "min_covrage: 0.25", "false_reject_rate", "judge.min_coverage",
       "missing; expected this key (is 'min_covrage' in line 58 a misspelling of it?)"},
      {"seed: 1", "sead: 1", "sead", "camera.sead", "unknown key, did you mean 'seed'?"},
      {"bind: 127.0.0.1", "bind: localhost", "localhost", "plc.tcp.bind", "IPv4 or IPv6 address"},
      {"port: 1502", "port: 65536", "65536", "plc.tcp.port", "0..65535"},
      {"allow: []", "allow: [10.0.0.1, '10.0.0.256']", "'10.0.0.256'", "plc.tcp.allow[1]",
       "IPv4 or IPv6"},
      {"enabled: true", "enabled: on", "on\n", "plc.tcp.enabled", "true or false"},
      {"unit_id: 1", "unit_id: 248", "248", "plc.unit_id", "1..247"},
      {"word_order: abcd", "word_order: dcba", "dcba", "plc.word_order", "one of abcd, cdab"},
      {"handshake_timeout_s: 10", "handshake_timeout_s: 0", "0\n", "plc.handshake_timeout_s",
       "0.1..3600"},
      {"recipes: []", "recipes: [a.yaml, ./a.yaml]", "./a.yaml", "files.recipes[1]",
       "a second time"},
      {"basis: basis/merl.basis", "basis: ''", "''", "files.basis", "a path"},
      {"  calibration: station.calibration.exr\n", "", "basis: basis", "files.calibration",
       "missing"},
  }));
  const TempDir dir;
  const std::string text = replaced(sample(), bad.from, bad.to);
  const std::string message = input_error([&] { return read_text(dir, text); });
  // The place is behind the replacement, or anywhere where another line offends.
  std::size_t at = text.find(bad.value, bad.to.empty() ? 0 : text.find(bad.to));
  if (at == std::string::npos) at = text.find(bad.value);
  const std::string place = (dir / "station.yaml").string() + ":" + place_of(text, at);
  CAPTURE(bad.from, bad.to, message, place);
  CHECK(contains(message, place + " (" + bad.path + "): "));
  CHECK(contains(message, bad.what));
}

TEST_CASE("A monitor patch and a part's height are read, printed and checked") {
  const TempDir dir;
  const std::string patch =
      "  part_height_mm: 2.5\n  monitor: {at_mm: [-56, 4], size_mm: [12, 10], "
      "albedo: [0.9, 0.89, 0.88], max_drift: 0.03}\n";
  const auto with = [&](const std::string& lines) {
    return replaced(sample(), "  colour: linear_srgb_d65\n", lines + "  colour: linear_srgb_d65\n");
  };
  const StationConfig config = read_text(dir, with(patch));
  CHECK(config.inspection.part_height_mm == 2.5);
  REQUIRE(config.inspection.monitor);
  CHECK(config.inspection.monitor->at_m.x() == -0.056);
  CHECK(config.inspection.monitor->size_m.y() == 0.010);
  CHECK(config.inspection.monitor->albedo[2] == 0.88);
  CHECK(config.inspection.monitor->max_drift == 0.03);
  REQUIRE(config.simulator.patch);
  CHECK(to_yaml(read_text(dir, to_yaml(config))) == to_yaml(config));
  // The patch is no part of what a calibration of sensor and rig depends on.
  CHECK(config.station_hash == read_text(dir, sample()).station_hash);
  CHECK_FALSE(read_text(dir, sample()).inspection.monitor);
  for (const auto& [from, to, what] : std::vector<std::array<std::string, 3>>{
           {"[-56, 4]", "[-46, 4]", "(inspection.monitor.at_mm): the patch reaches into"},
           {"[-56, 4]", "[-100, 0]", "beyond the camera's view"},
           {"0.88]", "1.2]", "inspection.monitor.albedo"},
           {", 0.88]", "]", "2 figures"},
           {"size_mm: [12, 10]", "size_mm: [0, 10]", "inspection.monitor.size_mm"},
           {"max_drift: 0.03", "max_drift: 1", "inspection.monitor.max_drift"},
           {"part_height_mm: 2.5", "part_height_mm: 51", "inspection.part_height_mm"}}) {
    CAPTURE(from, to);
    CHECK(contains(input_error([&] { return read_text(dir, with(replaced(patch, from, to))); }),
                   what));
  }
}

TEST_CASE("What the file says optional may be left out") {
  const TempDir dir;
  std::string text = sample();
  for (const char* line :
       {"  frame_timeout_ms:", "  seed:", "  heartbeat_timeout_s:", "  recipes:"}) {
    const std::size_t at = text.find(line);
    REQUIRE(at != std::string::npos);
    text.erase(at, text.find('\n', at) + 1 - at);
  }
  const std::size_t simulator = text.find("simulator:");
  text.erase(simulator, text.find("inspection:") - simulator);
  const StationConfig config = read_text(dir, text);
  const StationConfig full = read_text(dir, sample());
  CHECK(to_yaml(config) == to_yaml(full));
}

TEST_CASE("Every other key of the station file is required") {
  const TempDir dir;
  const brdfgate::YamlNode root = brdfgate::YamlNode::load_text(sample(), "f");
  const std::set<std::string> optional{"frame_timeout_ms", "seed",      "heartbeat_timeout_s",
                                       "recipes",          "simulator", "change_floor"};
  const YAML::Node tree = YAML::Load(sample());
  int removed = 0;
  const auto check = [&](const YAML::Node& without, const std::string& key) {
    if (optional.count(key) != 0) return;
    ++removed;
    const std::string message = input_error([&] { return read_text(dir, YAML::Dump(without)); });
    CAPTURE(key, message);
    CHECK(contains(message, key + "): missing"));
  };
  for (const auto& section : tree) {
    const auto name = section.first.as<std::string>();
    YAML::Node without = YAML::Clone(tree);
    without.remove(name);
    check(without, name);
    if (!section.second.IsMap()) continue;
    for (const auto& field : section.second) {
      YAML::Node smaller = YAML::Clone(tree);
      smaller[name].remove(field.first.as<std::string>());
      check(smaller, field.first.as<std::string>());
    }
  }
  CHECK(removed > 40);
}

TEST_CASE("The resolved configuration reads back to the same values from another folder") {
  const TempDir dir;
  std::string text = replaced(sample(), "allow: []", "allow: [10.0.0.1, '::1']");
  text = replaced(text, "recipes: []", "recipes: ['a, b.yaml', \"c: d.yaml\"]");
  text = replaced(text, "station: simulated bench", "station: 'true # {no}'");
  text = replaced(text, "seed: 1", "seed: 9223372036854775807");
  text = replaced(text, "line_time_us: 14.8", "line_time_us: 14.7654321");
  text = replaced(text, "word_order: abcd", "word_order: cdab");
  text = replaced(text, "colour: linear_srgb_d65", "colour: none");
  text = replaced(text, "read_noise_dn: 0.3", "read_noise_dn: 0.3\n    response: tone_curve");
  text = replaced(text, "vignetting: 0.15", "vignetting: 0.15\n  gamma: 2.2");
  text = replaced(text, "plc:", "upkeep: {max_age_days: 180, grace_days: 3}\nplc:");
  const StationConfig first = read_text(dir, text);
  const std::string yaml = to_yaml(first);
  const StationConfig second = read_station_config(dir.write("elsewhere/resolved.yaml", yaml));
  CHECK(to_yaml(second) == yaml);
  CHECK(second.name == "true # {no}");
  CHECK(second.camera.seed == 9223372036854775807u);
  CHECK(second.camera.scenes == first.camera.scenes);
  CHECK(second.files.recipes == first.files.recipes);
  CHECK(second.files.recipes[1] == dir / "c: d.yaml");
  CHECK(second.plc.tcp.allow == first.plc.tcp.allow);
  CHECK(second.simulator.line_time_s == first.simulator.line_time_s);
  CHECK(second.camera.tone_curve);
  CHECK(second.simulator.gamma == 2.2);
  CHECK(second.upkeep.max_age_days == 180);
  CHECK(second.upkeep.grace_days == 3);
  CHECK(second.station_hash == first.station_hash);
  CHECK(second.hash != first.hash);
}

TEST_CASE("The station hash follows what a calibration depends on and nothing else") {
  const TempDir dir;
  const std::string hash = read_text(dir, sample()).station_hash;
  for (const auto& [from, to] : std::vector<std::pair<std::string, std::string>>{
           {"station: simulated bench", "station: other"},
           {"distance_mm: 180", "distance_mm: 180.0"},
           {"# station", "# STATION"},
           {"eta: 40", "eta: 4"},
           {"read_noise_dn: 0.3", "read_noise_dn: 0.3\n    response: linear"},
           {"plc:", "upkeep: {max_age_days: 7}\nplc:"},
           {"port: 1502", "port: 502"},
           {"[0.03, 0.4, 5, 60]", "[0.03, 60]"}}) {
    CAPTURE(from, to);
    CHECK(read_text(dir, replaced(sample(), from, to)).station_hash == hash);
  }
  for (const auto& [from, to] : std::vector<std::pair<std::string, std::string>>{
           {"width: 1456", "width: 1400"},
           {"bits: 10", "bits: 12"},
           {"read_noise_dn: 0.3", "read_noise_dn: 0.3\n    response: tone_curve"},
           {"mosaic: rggb", "mosaic: bggr"},
           {"black_level_dn: 60", "black_level_dn: 61"},
           {"full_well_dn: 1023", "full_well_dn: 1022"},
           {"camera: {theta_deg: 55", "camera: {theta_deg: 54"},
           {"distance_mm: 180", "distance_mm: 181"},
           {"field_of_view_deg: 25", "field_of_view_deg: 26"},
           {"phi_deg: 180, distance_mm: 300", "phi_deg: 180, distance_mm: 299"},
           {"theta_deg: 20", "theta_deg: 21"}}) {
    CAPTURE(from, to);
    CHECK(read_text(dir, replaced(sample(), from, to)).station_hash != hash);
  }
}

TEST_CASE("A mutated station file loads or is refused, and nothing else happens") {
  const TempDir dir;
  std::mt19937_64 random(20160101);
  int loaded = 0;
  int refused = 0;
  for (int i = 0; i < 600; ++i) {
    const std::string text = brdfgate::test::mutated(sample(), random);
    CAPTURE(i, text);
    const std::string message = input_error([&] { return to_yaml(read_text(dir, text)); });
    (message == "(no error)" ? loaded : refused) += 1;
    REQUIRE_FALSE(contains(message, "\n"));
  }
  CHECK(loaded > 20);
  CHECK(refused > 200);
}
