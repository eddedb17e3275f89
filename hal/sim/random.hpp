// Seeds of the simulation: every draw is a function of what it is for, never of when it was made.
#pragma once

#include <cstdint>

namespace brdfgate {

/// SplitMix64's finaliser (Steele, Lea, Flood 2014): neighbouring inputs give unrelated outputs.
inline std::uint64_t mix_bits(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

/// The seed of sub-stream `stream` of `seed`.
inline std::uint64_t derive_seed(std::uint64_t seed, std::uint64_t stream) {
  return mix_bits(mix_bits(seed) ^ stream);
}

}  // namespace brdfgate
