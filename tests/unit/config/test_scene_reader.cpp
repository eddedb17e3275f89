#include <chrono>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <set>

#include "catch.hpp"
#include "config/scene_reader.hpp"
#include "model/merl.hpp"
#include "support/input_error.hpp"
#include "support/mutate.hpp"
#include "support/shipped.hpp"
#include "support/temp_dir.hpp"

using brdfgate::read_scene;
using brdfgate::Scene;
using brdfgate::SceneTarget;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::mutated;
using brdfgate::test::place_of;
using brdfgate::test::shipped_file;
using brdfgate::test::TempDir;
namespace fs = std::filesystem;

namespace {

/// Every key of a scene file, each at a value other than its default.
const std::string kFull = R"(target: part
lights_on: false
part:   {size_mm: [70, 60], present: true, face: back, back: {lambert: [0.1, 0.2, 0.3]}}
pose:   {shift_mm: [1, -2], rotation_deg: 3, tilt_deg: [0.5, -0.25], height_mm: 0.5}
jitter: {shift_mm: 0.1, rotation_deg: 0.2, tilt_deg: 0.3, height_mm: 0.4}
materials:
  - {name: print, lambert: [0.2, 0.3, 0.4]}
  - {name: trim, ggx: {diffuse: [0.1, 0.1, 0.1], f0: [0.04, 0.04, 0.04], alpha: 0.2}}
  - {name: cap, abc: {kd: [0.1, 0.2, 0.3], a: [1, 2, 3], b: 30, c: 1.5, ior: 1.5}}
  - name: paint
    sgd: {rho_d: [0.1, 0.1, 0.1], rho_s: [0.2, 0.2, 0.2], alpha: [0.1, 0.1, 0.1],
          p: [0.5, 0.5, 0.5], f0: [0.04, 0.04, 0.04], f1: [-0.1, 0, 0.1], kap: [40, 40, 40],
          lambda: [2, 2, 2], c: [1.0e-7, 1.0e-7, 1.0e+38], k: [40, 40, 40], theta0: [-0.1, 0, 0.1]}
regions: mask.png
variation: {albedo: 0.01, gloss: 0.02, roughness: 0.03}
change:
  - {material: trim, roughness: 1.15, albedo: 0.95, hue_deg: -5, gloss: 1.5}
defects:
  - {kind: stain, at_mm: [10, -5], size_mm: 4, strength: 0.25}
  - {kind: dull, at_mm: [0, 0], strength: 2}
light:  {drift: [0.01, -0.02], ambient: 0.03}
sensor: {noise: false, defocus_px: 0.7}
)";

void write_mask(const TempDir& dir, int largest) {
  cv::Mat mask(3, 5, CV_8UC1, cv::Scalar(0));
  mask.at<unsigned char>(1, 4) = static_cast<unsigned char>(largest);
  cv::imwrite((dir / "mask.png").string(), mask);
}

}  // namespace

TEST_CASE("Every key of a scene file arrives in the scene") {
  const TempDir dir;
  write_mask(dir, 3);
  const Scene scene = read_scene(dir.write("scene.yaml", kFull));
  CHECK(scene.target == SceneTarget::part);
  CHECK_FALSE(scene.lights_on);
  CHECK(scene.part_size_mm == std::array<double, 2>{70, 60});
  CHECK_FALSE(scene.face_front);
  CHECK(scene.back_albedo[2] == 0.3);
  CHECK(scene.pose.shift_mm == std::array<double, 2>{1, -2});
  CHECK(scene.pose.rotation_deg == 3);
  CHECK(scene.pose.tilt_deg == std::array<double, 2>{0.5, -0.25});
  CHECK(scene.pose.height_mm == 0.5);
  CHECK(scene.jitter.shift_mm == std::array<double, 2>{0.1, 0.1});
  CHECK(scene.jitter.rotation_deg == 0.2);
  CHECK(scene.jitter.tilt_deg == std::array<double, 2>{0.3, 0.3});
  CHECK(scene.jitter.height_mm == 0.4);
  REQUIRE(scene.materials.size() == 4);
  CHECK(scene.materials[3].name == "paint");
  CHECK(scene.materials[0].brdf->diffuse(0.3)[2] == Approx(0.4 / 3.14159265358979));
  CHECK(scene.materials[2].brdf->diffuse(0.3)[1] == Approx(0.2 / 3.14159265358979));
  CHECK(scene.regions.size() == cv::Size(5, 3));
  CHECK(scene.regions.at<unsigned char>(1, 4) == 3);
  CHECK(scene.variation.albedo == 0.01);
  CHECK(scene.variation.gloss == 0.02);
  CHECK(scene.variation.roughness == 0.03);
  REQUIRE(scene.changes.size() == 1);
  CHECK(scene.changes[0].material == "trim");
  CHECK(scene.changes[0].change.roughness == 1.15);
  CHECK(scene.changes[0].change.albedo == 0.95);
  CHECK(scene.changes[0].change.hue_deg == -5);
  CHECK(scene.changes[0].change.gloss == 1.5);
  REQUIRE(scene.defects.size() == 2);
  CHECK(scene.defects[0].size_mm == 4);
  CHECK(scene.defects[0].strength == 0.25);
  CHECK(scene.defects[1].kind == brdfgate::DefectKind::dull);
  CHECK(scene.light.drift == std::array<double, 2>{0.01, -0.02});
  CHECK(scene.light.ambient == 0.03);
  CHECK_FALSE(scene.sensor.noise);
  CHECK(scene.sensor.defocus_px == 0.7);
}

TEST_CASE("What a scene file leaves out is as documented") {
  const TempDir dir;
  const Scene scene = read_scene(dir.write("s.yaml", "materials: [{name: a, lambert: [0, 0, 1]}]"));
  CHECK(scene.target == SceneTarget::part);
  CHECK(scene.lights_on);
  CHECK(scene.part_size_mm == std::array<double, 2>{80, 80});
  CHECK(scene.present);
  CHECK(scene.face_front);
  CHECK(scene.back_albedo[0] == 0.3);
  CHECK(scene.regions.empty());
  CHECK(scene.changes.empty());
  CHECK(scene.sensor.noise);
  CHECK(read_scene(dir.write("w.yaml", "target: white")).materials.empty());
  CHECK(read_scene(dir.write("w.yaml", "target: white")).sag_mm == 0);
  CHECK(read_scene(dir.write("b.yaml", "target: white\nreference: {sag_mm: 1.5}")).sag_mm == 1.5);
}

TEST_CASE("Every shipped scene loads and shows what its name says") {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(shipped_file("scenes"))) {
    if (entry.path().extension() != ".yaml") continue;
    CAPTURE(entry.path());
    CHECK_NOTHROW(read_scene(entry.path()));
    names.insert(entry.path().stem());
  }
  CHECK(names.size() >= 11);
  const auto scene = [](const char* name) {
    return read_scene(shipped_file("scenes") / (std::string(name) + ".yaml"));
  };
  const Scene good = scene("good");
  REQUIRE(good.materials.size() == 2);
  double most = 0;
  cv::minMaxLoc(good.regions, nullptr, &most);
  CHECK(most == 1);
  CHECK(good.changes.empty());
  CHECK(good.defects.empty());
  CHECK(scene("bad_gloss").changes.at(0).change.roughness == 1.25);
  CHECK(scene("bad_colour").changes.at(0).change.hue_deg == 12);
  CHECK(scene("stain").defects.at(0).kind == brdfgate::DefectKind::stain);
  CHECK_FALSE(scene("upside_down").face_front);
  CHECK_FALSE(scene("absent").present);
  CHECK(scene("white").target == SceneTarget::white);
  CHECK_FALSE(scene("dark").lights_on);
  CHECK(scene("board").target == SceneTarget::board);
  CHECK(scene("mirror").target == SceneTarget::mirror);
  CHECK(scene("black").target == SceneTarget::black);
}

TEST_CASE("Every rule of a scene file complains at its place with its path") {
  struct Bad {
    std::string from, to, value, path, what;
  };
  const auto bad = GENERATE(values<Bad>({
      {"target: part", "target: pert", "pert", "target", "did you mean 'part'?"},
      {"target: part", "target: part\nlight_on: true", "light_on", "light_on",
       "did you mean 'lights_on'?"},
      {"lights_on: false", "lights_on: 0", "0", "lights_on", "true or false"},
      {"[70, 60]", "[70, 0]", "0],", "part.size_mm[1]", "above 0"},
      {"face: back", "face: side", "side", "part.face", "one of front, back"},
      {"back: {lambert: [0.1,", "back: {lambert: [1.1,", "1.1", "part.back.lambert[0]", "0..1"},
      {"shift_mm: [1, -2]", "shift_mm: 1", "1,", "pose.shift_mm", "a sequence"},
      {"tilt_deg: [0.5,", "tilt_deg: [46,", "46", "pose.tilt_deg[0]", "-45..45"},
      {"shift_mm: 0.1", "shift_mm: -0.1", "-0.1", "jitter.shift_mm", "0..1000"},
      {"lambert: [0.2, 0.3, 0.4]", "lambert: [0.2, -0.1, 0.4]", "-0.1", "materials[0].lambert[1]",
       "0..1"},
      {"lambert: [0.2, 0.3, 0.4]", "lambert: [0.2, 0.3]", "[0.2, 0.3]", "materials[0].lambert",
       "2 values; expected 3 of them"},
      {"lambert: [0.2, 0.3, 0.4]", "lamber: [0.2]", "lamber", "materials[0].lamber",
       "did you mean 'lambert'?"},
      {"{name: print, lambert: [0.2, 0.3, 0.4]}", "{name: print}", "{name: print}", "materials[0]",
       "no model; expected exactly one of brdf, abc, sgd, lambert, phong, blinn_phong, ward, ggx, "
       "beckmann, blend"},
      {"name: print,", "name: print, brdf: a.binary,", "{name: print, brdf", "materials[0]",
       "both brdf and lambert"},
      {"name: trim", "name: print", "print, ggx", "materials[1].name", "'print' a second time"},
      {"name: trim", "name: ''", "''", "materials[1].name", "a name"},
      {"alpha: 0.2", "alpha: 0", "0}", "materials[1].ggx.alpha", "above 0 and at most 1"},
      {"alpha: 0.2", "alpha: 1.01", "1.01", "materials[1].ggx.alpha", "above 0 and at most 1"},
      {"f0: [0.04, 0.04, 0.04], alpha", "f0: [2, 0.04, 0.04], alpha", "2,",
       "materials[1].ggx.f0[0]", "0..1"},
      {"b: 30", "b: -30", "-30", "materials[2].abc.b", "0.."},
      {"ior: 1.5", "ior: 0.9", "0.9", "materials[2].abc.ior", "1..1000"},
      {"a: [1, 2, 3]", "a: [1, -2, 3]", "-2", "materials[2].abc.a[1]", "0.."},
      {"rho_s: [0.2,", "rho_s: [-0.2,", "-0.2", "materials[3].sgd.rho_s[0]", "0.."},
      {"    sgd: {rho_d: [0.1, 0.1, 0.1], ", "    sgd: {", "{rho_s", "materials[3].sgd.rho_d",
       "missing"},
      {"lambert: [0.2, 0.3, 0.4]", "brdf: none.binary", "none.binary", "materials[0].brdf",
       "none.binary: cannot be opened"},
      {"lambert: [0.2, 0.3, 0.4]", "brdf: scene.yaml", "scene.yaml", "materials[0].brdf",
       "scene.yaml: "},
      {"lambert: [0.2, 0.3, 0.4]", "brdf: .", ".}", "materials[0].brdf", ": "},
      {"regions: mask.png", "regions: none.png", "none.png", "regions", "none.png: no such file"},
      {"regions: mask.png", "regions: scene.yaml", "scene.yaml", "regions", "not a PNG file"},
      {"albedo: 0.01", "albedo: -0.01", "-0.01", "variation.albedo", "0..1"},
      {"material: trim", "material: rim", "rim", "change[0].material", "no material 'rim'"},
      {"roughness: 1.15", "roughness: 0", "0,", "change[0].roughness", "above 0"},
      {"defects:", "  - {material: trim}\ndefects:", "trim}", "change[1].material",
       "'trim' a second time"},
      {"kind: stain", "kind: strain", "strain", "defects[0].kind", "did you mean 'stain'?"},
      {"at_mm: [10, -5]", "at_mm: [36, -5]", "[36, -5]", "defects[0].at_mm",
       "36 mm lies beside the part; expected at most 35 mm"},
      {"strength: 0.25", "strength: 1.5", "1.5", "defects[0].strength", "0..1"},
      {"size_mm: 4", "size_mm: 0", "0,", "defects[0].size_mm", "above 0"},
      {"drift: [0.01,", "drift: [-1.5,", "-1.5", "light.drift[0]", "-1..10"},
      {"defocus_px: 0.7", "defocus_px: -1", "-1", "sensor.defocus_px", "0..100"},
  }));
  const TempDir dir;
  write_mask(dir, 3);
  const std::string text = brdfgate::test::replaced(kFull, bad.from, bad.to);
  const fs::path file = dir.write("scene.yaml", text);
  const std::string message = input_error([&] { return read_scene(file).lights_on; });
  std::size_t at = text.find(bad.value, text.find(bad.to));
  if (at == std::string::npos) at = text.find(bad.value);
  CAPTURE(bad.to, message, place_of(text, at));
  CHECK(contains(message, file.string() + ":" + place_of(text, at) + " (" + bad.path + "): "));
  CHECK(contains(message, bad.what));
}

TEST_CASE("A part needs materials, an absent one does not") {
  const TempDir dir;
  const auto read = [&](const std::string& text) {
    return input_error([&] { return read_scene(dir.write("s.yaml", text)).present; });
  };
  CHECK(contains(read("lights_on: true"), "(materials): missing"));
  CHECK(contains(read("materials: []"), "(materials): 0 materials"));
  CHECK(contains(read("part: {present: false}\nregions: a.png"), "(regions): a mask without"));
  CHECK(read("part: {present: false}") == "(no error)");
  CHECK(contains(read(""), "empty"));
}

TEST_CASE("A mask that names no material tells value, pixel and count") {
  const TempDir dir;
  write_mask(dir, 4);
  const fs::path file = dir.write("scene.yaml", kFull);
  const std::string message = input_error([&] { return read_scene(file).lights_on; });
  CHECK(contains(message, "index 4 in column 4, row 1; expected below the number of materials, 4"));
  CHECK(contains(message, "(regions)"));
  cv::imwrite((dir / "mask.png").string(), cv::Mat(3, 5, CV_8UC3, cv::Scalar(0, 0, 0)));
  CHECK(contains(input_error([&] { return read_scene(file).lights_on; }), "colour type 2"));
}

TEST_CASE("A measured material is opened once until its file changes") {
  const TempDir dir;
  brdfgate::MerlTable table;
  const auto fill = [&](double value) {
    for (auto& channel : table.f)
      channel.assign(channel.size(), value);
    brdfgate::write_merl(dir / "m/a.binary", table);
  };
  fs::create_directories(dir / "m");
  fill(0.25);
  const fs::path file = dir.write("s/scene.yaml", "materials: [{name: a, brdf: ../m/a.binary}]");
  const auto first = read_scene(file).materials.at(0).brdf;
  const auto second = read_scene(file).materials.at(0).brdf;
  CHECK(first == second);
  CHECK(first->eval({0.2, 0.3, 0.4})[1] == Approx(0.25));
  fill(0.5);
  fs::last_write_time(dir / "m/a.binary",
                      fs::last_write_time(dir / "m/a.binary") + std::chrono::seconds(1));
  CHECK(read_scene(file).materials.at(0).brdf->eval({0.2, 0.3, 0.4})[1] == Approx(0.5));
  CHECK(first->eval({0.2, 0.3, 0.4})[1] == Approx(0.25));
}

TEST_CASE("A mutated scene loads or is refused, and nothing else happens") {
  const TempDir dir;
  write_mask(dir, 3);
  std::mt19937_64 random(20120401);
  int loaded = 0;
  int refused = 0;
  for (int i = 0; i < 600; ++i) {
    const std::string text = mutated(kFull, random);
    CAPTURE(i, text);
    const std::string message =
        input_error([&] { return read_scene(dir.write("scene.yaml", text)).lights_on; });
    (message == "(no error)" ? loaded : refused) += 1;
    REQUIRE_FALSE(contains(message, "\n"));
  }
  CHECK(loaded > 20);
  CHECK(refused > 200);
}
