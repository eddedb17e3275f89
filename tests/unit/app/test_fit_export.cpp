#include <string>

#include "app/fit_export.hpp"
#include "catch.hpp"
#include "config/scene_reader.hpp"
#include "model/analytic.hpp"
#include "model/projection.hpp"
#include "model/validation.hpp"
#include "support/input_error.hpp"
#include "support/shipped.hpp"
#include "support/small_basis.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::read_text_file;
using brdfgate::test::TempDir;

namespace {

/// A part of two clusters, of which only the second was measured: a GGX material.
Inspection measured_part(const Basis& basis) {
  const BrdfPtr ggx =
      make_brdf(GgxParameters{Rgb(0.0192, 0.096, 0.384), Rgb(0.04, 0.036, 0.032), 0.3});
  Inspection part;
  part.result.clusters.resize(2);
  ClusterResult& cluster = part.result.clusters[1];
  cluster.index = 1;
  cluster.valid.weights = true;
  cluster.raw = project(basis, *ggx);
  ValidationRig rig;
  rig.lattice = 8;
  part.samples = {BinnedSamples{}, observe_exactly(*ggx, rig)};
  return part;
}

/// The file's entry as the only material of a scene.
Scene scene_of(const TempDir& dir, const std::string& entry) {
  std::string text = "materials:\n  -\n    ";
  for (const char c : entry)
    text += c == '\n' ? std::string("\n    ") : std::string(1, c);
  return read_scene(dir.write("scene.yaml", text));
}

}  // namespace

TEST_CASE("a measured cluster is exported as parameters that a scene file takes") {
  const auto basis = test::small_basis(20);
  const TempDir dir;
  export_fits(dir.path(), measured_part(*basis), *basis, "ggx");
  CHECK_FALSE(std::filesystem::exists(dir / "cluster_0.yaml"));
  const std::string text = read_text_file(dir / "cluster_1.yaml");
  CHECK(contains(text, "# ggx fitted to the reconstruction (L1): mean error 0.0"));
  CHECK(contains(text, "\n# the measurement calls for "));
  const Scene scene = scene_of(dir, text);
  REQUIRE(scene.materials.size() == 1);
  CHECK(scene.materials[0].name == "cluster_1");
  CHECK(scene.materials[0].brdf->diffuse(0)[2] * 3.14159 == Approx(0.384).epsilon(0.1));
}

TEST_CASE("the best model is one of those there are") {
  const auto basis = test::small_basis(20);
  const TempDir dir;
  export_fits(dir.path(), measured_part(*basis), *basis, "best");
  CHECK(scene_of(dir, read_text_file(dir / "cluster_1.yaml")).materials.size() == 1);
}

TEST_CASE("no model named, nothing written; an unknown one is refused") {
  const auto basis = test::small_basis(20);
  const TempDir dir;
  export_fits(dir.path(), measured_part(*basis), *basis, "");
  CHECK(std::filesystem::is_empty(dir.path()));
  CHECK(contains(input_error([&] {
                   export_fits(dir.path(), measured_part(*basis), *basis, "lafortune");
                   return 0;
                 }),
                 "'lafortune' is unknown; expected one of lambert, phong"));
}
