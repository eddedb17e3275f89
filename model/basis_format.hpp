// Layout of a basis file.
//
//   8 bytes   magic
//   text      "field: value" lines, an empty line, then NUL up to a multiple of 64
//   payload   singular values  f64[k]
//             validity         u8[cells], 1 where the file has a row for the cell
//             mean             f32[rows]
//             median           f32[rows], 1/sr
//             components       f16[rows][k]: Q = V S, IEEE 754 binary16
//             training weights f32[observations][k]: U
//             exemplars        f32[exemplars][13]: exemplars.hpp, ExemplarRecord
//             exemplar weights f32[exemplars][k]
//
// Each array starts at a multiple of 64; gaps are NUL. Little-endian. Rows are the valid cells in
// cell order (phi_d fastest). Values of components rise to a few tens, so half floats need no
// scale.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>

#include "model/basis.hpp"

namespace brdfgate {

inline constexpr int kBasisVersion = 2;

/// Offsets in bytes from the payload's start, and its size.
struct BasisLayout {
  std::size_t singular_values;
  std::size_t validity;
  std::size_t mean;
  std::size_t median;
  std::size_t components;
  std::size_t training_weights;
  std::size_t exemplars;
  std::size_t exemplar_weights;
  std::size_t size;
};
BasisLayout basis_layout(const BasisInfo& info);

/// Everything before the payload. info.checksum is that of the payload.
/// Throws InputError where a text holds a line break.
std::string encode_basis_header(const BasisInfo& info);

struct BasisHeader {
  BasisInfo info;
  std::size_t payload_start = 0;
};
/// Reads and validates everything before the payload; sizes are bounded, so that no product of them
/// overflows. Throws InputError naming the file and the field.
BasisHeader decode_basis_header(const std::filesystem::path& file,
                                std::span<const std::byte> bytes);

/// The error of a basis file's field.
[[noreturn]] void refuse_basis_field(const std::filesystem::path& file, const std::string& field,
                                     const std::string& what, const std::string& expected = "");

}  // namespace brdfgate
