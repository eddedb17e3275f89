#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <opencv2/core/utility.hpp>
#include <stdexcept>

#include "catch.hpp"
#include "model/gram.hpp"
#include "model/mapped_file.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::TempDir;

namespace {

const BasisGrid kGrid{24, 12, 12};

std::string bytes_of(const std::filesystem::path& file) {
  const MappedFile mapped(file);
  return {reinterpret_cast<const char*>(mapped.bytes().data()), mapped.bytes().size()};
}

/// Bit by bit, so that -0 and 0 differ.
bool same_bits(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() &&
         std::equal(a.data(), a.data() + a.size(), b.data(), [](double x, double y) {
           return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y);
         });
}

/// OpenCV's number of threads for the life of the object.
struct Threads {
  explicit Threads(int n) : before(cv::getNumThreads()) { cv::setNumThreads(n); }
  ~Threads() { cv::setNumThreads(before); }
  int before;
};

/// 30 materials: more observations than one tile of the matrix.
std::vector<NamedBrdf> many_materials() {
  std::vector<NamedBrdf> set;
  for (int i = 0; i < 30; ++i) {
    GgxParameters p;
    p.diffuse = Rgb(0.01 * i, 0.3 - 0.005 * i, 0.1);
    p.f0 = Rgb::Constant(0.04 + 0.02 * i);
    p.alpha = 0.05 + 0.02 * i;
    set.push_back({"lobe-" + std::to_string(i), make_brdf(p)});
  }
  return set;
}

struct Interrupted : std::runtime_error {
  Interrupted() : std::runtime_error("interrupted") {}
};

/// Accumulates until `slabs` are done, then throws as a caller's progress might.
void interrupt_after(int slabs, const TrainingSources& sources, GramOptions options) {
  options.progress = [slabs](int done) {
    if (done == slabs) throw Interrupted();
  };
  CHECK_THROWS_AS(accumulate_gram(sources, kGrid, options), Interrupted);
}

}  // namespace

TEST_CASE("the Gram matrix is that of the mapped observations less their mean") {
  const TrainingSources sources = open_sources(many_materials());
  const GramState state = accumulate_gram(sources, kGrid);
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(90, 90);
  for (int h = 0; h < kGrid.theta_h; ++h) {
    Slab slab = sample_slab(sources, kGrid, h);
    map_slab(slab);
    CHECK(slab.f.colwise().mean().cwiseAbs().maxCoeff() < 1e-12);
    expected += slab.f * slab.f.transpose();
  }
  CHECK((state.gram - expected).norm() < 1e-12 * expected.norm());
  CHECK(same_bits(state.gram, state.gram.transpose()));
}

TEST_CASE("the Gram matrix does not depend on the number of threads, to the last bit") {
  const TrainingSources sources = open_sources(many_materials());
  const auto with_threads = [&](int n) {
    const Threads threads(n);
    return accumulate_gram(sources, kGrid);
  };
  const GramState alone = with_threads(1);
  const GramState together = with_threads(2);
  CHECK(same_bits(alone.gram, together.gram));
  CHECK(alone.values_hash == together.values_hash);
}

TEST_CASE("an interrupted accumulation goes on from its checkpoint to the same bits") {
  const TempDir dir;
  const TrainingSources sources = open_sources(test::small_training_set());
  const GramState whole = accumulate_gram(sources, kGrid);
  GramOptions options;
  options.checkpoint = {dir / "a.checkpoint", "key", 5};
  interrupt_after(13, sources, options);
  std::vector<std::string> messages;
  std::vector<int> told;
  options.message = [&](const std::string& m) { messages.push_back(m); };
  options.progress = [&](int slabs) { told.push_back(slabs); };
  const GramState resumed = accumulate_gram(sources, kGrid, options);
  CHECK(same_bits(whole.gram, resumed.gram));
  CHECK(whole.values_hash == resumed.values_hash);
  REQUIRE(messages.size() == 1);
  CHECK(messages[0].find("after slab 10") != std::string::npos);
  CHECK(told.front() == 11);
  // Interrupted in the pass behind this one, nothing is left to do.
  told.clear();
  CHECK(same_bits(whole.gram, accumulate_gram(sources, kGrid, options).gram));
  CHECK(told.empty());
}

TEST_CASE("a checkpoint that is not this training's is ignored, and it is said why") {
  const TempDir dir;
  const TrainingSources sources = open_sources(test::small_training_set());
  const GramState whole = accumulate_gram(sources, kGrid);
  GramOptions options;
  options.checkpoint = {dir / "a.checkpoint", "key", 5};
  interrupt_after(13, sources, options);
  const std::string good = bytes_of(dir / "a.checkpoint");
  std::string message;
  options.message = [&](const std::string& m) { message += m; };
  const auto said_with = [&](const std::string& bytes, const std::string& key) {
    dir.write("a.checkpoint", bytes);
    options.checkpoint.key = key;
    message.clear();
    CHECK(same_bits(whole.gram, accumulate_gram(sources, kGrid, options).gram));
    return message;
  };
  CHECK(said_with(good, "other").find("other materials or options") != std::string::npos);
  CHECK(said_with(good.substr(0, good.size() - 8), "key").find("damaged") != std::string::npos);
  std::string flipped = good;
  flipped[good.size() / 2] = static_cast<char>(flipped[good.size() / 2] ^ 1);
  CHECK(said_with(flipped, "key").find("damaged") != std::string::npos);
  CHECK(said_with("", "key").find("no checkpoint") != std::string::npos);
  CHECK(said_with("a text", "key").find("no checkpoint") != std::string::npos);
  std::filesystem::remove(dir / "a.checkpoint");
  std::string reason;
  CHECK_FALSE(load_checkpoint(options.checkpoint, 27, reason).has_value());
  CHECK(reason.empty());
  dir.write("a.checkpoint", good);
  CHECK_FALSE(load_checkpoint(options.checkpoint, 30, reason).has_value());
  CHECK(reason.find("another size") != std::string::npos);
}

TEST_CASE("two fits of one material are two observations of each of its colours") {
  auto set = test::small_training_set();
  const auto refit = set[4].brdf;
  set.push_back({set[3].name, refit, 1});
  const TrainingSources sources = open_sources(set);
  CHECK(sources.observations() == 30);
  CHECK(sources.names().substr(sources.names().rfind(',') + 1) == set[3].name);
  const GramState state = accumulate_gram(sources, kGrid);
  // The refit is here the very BRDF of another material, so the observations coincide.
  CHECK((state.gram.row(27) - state.gram.row(12)).norm() < 1e-9 * state.gram.row(12).norm());
}
