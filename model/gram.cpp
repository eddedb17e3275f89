#include "model/gram.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

#include "model/error.hpp"
#include "model/hash.hpp"
#include "model/mapped_file.hpp"
#include "model/parallel.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

/// A checkpoint: magic, key, hash of the values, slabs, m, m x m doubles, SHA-256 of all that.
constexpr std::string_view kMagic = "BRDFGRM1";
constexpr std::size_t kHashLength = 64;
constexpr std::size_t kHeadBytes = kMagic.size() + 2 * kHashLength + 2 * sizeof(std::int64_t);

std::string padded(std::string hash) {
  hash.resize(kHashLength, ' ');
  return hash;
}

std::string encode(const std::string& key, const GramState& state) {
  const std::array<std::int64_t, 2> numbers{state.slabs, state.gram.rows()};
  std::string text = std::string(kMagic) + padded(key) + padded(state.values_hash);
  text.append(reinterpret_cast<const char*>(numbers.data()), sizeof numbers);
  text.append(reinterpret_cast<const char*>(state.gram.data()),
              static_cast<std::size_t>(state.gram.size()) * sizeof(double));
  return text + sha256_hex(text);
}

/// Cuts fields off the front of a text.
struct Reader {
  std::string_view rest;
  std::string_view take(std::size_t n) {
    const std::string_view field = rest.substr(0, n);
    rest.remove_prefix(field.size());
    return field;
  }
};

/// Tiles of the lower triangle, each a sum over the slab's cells in one order: the result does not
/// depend on who computes which.
void add_slab(Eigen::MatrixXd& gram, const Eigen::MatrixXd& x) {
  constexpr Index kTile = 64;
  std::vector<std::pair<Index, Index>> tiles;
  for (Index row = 0; row < gram.rows(); row += kTile) {
    for (Index column = 0; column <= row; column += kTile)
      tiles.emplace_back(row, column);
  }
  parallel_for_each(static_cast<int>(tiles.size()), [&](int i) {
    const auto [row, column] = tiles[static_cast<std::size_t>(i)];
    const Index rows = std::min(kTile, gram.rows() - row);
    const Index columns = std::min(kTile, gram.rows() - column);
    gram.block(row, column, rows, columns).noalias() +=
        x.middleRows(row, rows) * x.middleRows(column, columns).transpose();
  });
}

GramState start(const TrainingSources& sources, const GramOptions& options) {
  const Index m = sources.observations();
  if (!options.checkpoint.file.empty()) {
    std::string reason;
    std::optional<GramState> state = load_checkpoint(options.checkpoint, m, reason);
    if (options.message && state) {
      options.message("goes on after slab " + std::to_string(state->slabs) + " of " +
                      options.checkpoint.file.string());
    }
    if (options.message && !reason.empty()) options.message("starts anew: " + reason);
    if (state) return std::move(*state);
  }
  GramState state;
  state.gram.setZero(m, m);
  return state;
}

}  // namespace

void save_checkpoint(const GramCheckpoint& checkpoint, const GramState& state) {
  AtomicFile file(checkpoint.file);
  const std::string text = encode(checkpoint.key, state);
  file.write(std::as_bytes(std::span(text)));
  file.commit();
}

std::optional<GramState> load_checkpoint(const GramCheckpoint& checkpoint, Index observations,
                                         std::string& reason) {
  reason.clear();
  if (!std::filesystem::exists(checkpoint.file)) return std::nullopt;
  const auto ignored = [&](const char* why) {
    reason = checkpoint.file.string() + " " + why;
    return std::nullopt;
  };
  const MappedFile file(checkpoint.file);
  const std::string_view text(reinterpret_cast<const char*>(file.bytes().data()),
                              file.bytes().size());
  if (text.size() < kHeadBytes + kHashLength || !text.starts_with(kMagic)) {
    return ignored("is no checkpoint");
  }
  const std::string_view body = text.substr(0, text.size() - kHashLength);
  if (sha256_hex(std::as_bytes(std::span(body))) != text.substr(body.size())) {
    return ignored("is damaged");
  }
  Reader reader{body.substr(kMagic.size())};
  if (reader.take(kHashLength) != padded(checkpoint.key)) {
    return ignored("is of other materials or options");
  }
  GramState state;
  state.values_hash = reader.take(kHashLength);
  state.values_hash.erase(state.values_hash.find_last_not_of(' ') + 1);
  std::array<std::int64_t, 2> numbers{};
  std::memcpy(numbers.data(), reader.take(sizeof numbers).data(), sizeof numbers);
  const std::size_t bytes = static_cast<std::size_t>(observations * observations) * sizeof(double);
  if (numbers[1] != observations || reader.rest.size() != bytes) {
    return ignored("is of another size");
  }
  state.slabs = static_cast<int>(numbers[0]);
  state.gram.resize(observations, observations);
  std::memcpy(state.gram.data(), reader.rest.data(), bytes);
  return state;
}

GramState accumulate_gram(const TrainingSources& sources, const BasisGrid& grid,
                          const GramOptions& options) {
  GramState state = start(sources, options);
  const GramCheckpoint& checkpoint = options.checkpoint;
  while (state.slabs < grid.theta_h) {
    Slab slab = sample_slab(sources, grid, state.slabs);
    if (sources.files.empty()) {
      const std::span<const double> values(slab.f.data(), static_cast<std::size_t>(slab.f.size()));
      state.values_hash = sha256_hex(state.values_hash + sha256_hex(std::as_bytes(values)));
    }
    map_slab(slab);
    add_slab(state.gram, slab.f);
    sources.drop_pages();
    ++state.slabs;
    const bool due = state.slabs % checkpoint.interval == 0 || state.slabs == grid.theta_h;
    if (!checkpoint.file.empty() && due) save_checkpoint(checkpoint, state);
    if (options.progress) options.progress(state.slabs);
  }
  const Eigen::MatrixXd both = state.gram.selfadjointView<Eigen::Lower>();
  state.gram = both;
  return state;
}

}  // namespace brdfgate
