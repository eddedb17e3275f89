#include "catch.hpp"
#include "config/material_reader.hpp"
#include "config/material_writer.hpp"
#include "config/scene_reader.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;

namespace {

const std::vector<Lobe> kLobes{
    {LobeModel::lambert, {0.1, 1.0 / 3, 0.7}, Rgb::Zero(), {}},
    {LobeModel::phong, {0.1, 0.3, 0.6}, {0.3, 1e-6, 0.1}, {1.0 / 7}},
    {LobeModel::blinn_phong, {0.1, 0.3, 0.6}, {0.3, 0.2, 0.1}, {123456.789}},
    {LobeModel::ward, {0, 0.3, 1}, {0.3, 0.2, 0.1}, {0.12}},
    {LobeModel::ggx, {0.1, 0.3, 0.6}, {0.08, 0.05, 0.04}, {0.1 + 0.2}},
    {LobeModel::beckmann, {0.1, 0.3, 0.6}, {0.08, 0.05, 0.04}, {1}},
    {LobeModel::blend, {0.1, 0.3, 0.6}, {6e7, 40, 1e-6}, {50, 0, 1.6}}};

/// The entry as an item of a scene's list.
std::string scene_with(const std::string& entry) {
  std::string scene = "materials:\n  -\n";
  std::size_t start = 0;
  while (start < entry.size()) {
    const std::size_t end = entry.find('\n', start);
    scene += "    " + entry.substr(start, end - start) + "\n";
    start = end + 1;
  }
  return scene;
}

}  // namespace

TEST_CASE("a fitted material written as YAML is the same material in a scene") {
  for (const Lobe& lobe : kLobes) {
    const std::string text = material_yaml("cluster_3", lobe);
    INFO(text);
    const test::TempDir dir;
    const Scene scene = read_scene(dir.write("scene.yaml", scene_with(text)));
    REQUIRE(scene.materials.size() == 1);
    CHECK(scene.materials[0].name == "cluster_3");
    const BrdfPtr truth = make_brdf(lobe);
    for (const HalfDiff& at : {HalfDiff{0, 0.2, 0}, HalfDiff{0.1, 0.7, 1}, HalfDiff{0.8, 0.3, 2}})
      CHECK((scene.materials[0].brdf->eval(at) == truth->eval(at)).all());
  }
}

TEST_CASE("a model's parameters are refused at their place") {
  struct Bad {
    const char* material;
    const char* said;
  };
  const std::vector<Bad> cases{
      {"phong: {diffuse: [0, 0, 0], specular: [0, 0, 0]}",
       "(materials[0].phong.exponent): missing"},
      {"phong: {diffuse: [0, 0, 0], specular: [0, 0, 0], exponent: 0}", "above 0"},
      {"phong: {diffuse: [0, 0, 0], specular: [0, 2, 0], exponent: 9}",
       "(materials[0].phong.specular[1])"},
      {"ward: {diffuse: [0, 0, 0], specular: [0, 0, 0], alpha: 2}", "at most 1"},
      {"ward: {diffuse: [0, 0, 0], f0: [0, 0, 0], alpha: 0.2}", "specular"},
      {"beckmann: {diffuse: [0, 0, 0], f0: [0, 0, 0], alpha: 0.2, ior: 2}", "ior"},
      {"blend: {diffuse: [0, 0, 0], specular: [0, 0, 0], exponent: 9, alpha: 1.2, ior: 1.5}",
       "(materials[0].blend.alpha)"},
      {"blend: {diffuse: [0, 0, 0], specular: [0, 0, 0], exponent: 9, alpha: 0.2, ior: 1}",
       "above 1 and at most 1000"},
      {"ggx: {diffuse: [0, 0, 0], f0: [0, 0, 0], alpha: .nan}", "(materials[0].ggx.alpha)"},
      {"ggx: 3", "(materials[0].ggx)"}};
  const test::TempDir dir;
  for (const Bad& bad : cases) {
    const auto file =
        dir.write("s.yaml", "materials: [{name: a, " + std::string(bad.material) + "}]");
    const std::string message = input_error([&] { return read_scene(file).present; });
    INFO(bad.material << ": " << message);
    CHECK(contains(message, bad.said));
    CHECK(contains(message, file.string() + ":1:"));
  }
}
