// The words of the register map, written and read by name.
//
// u32 and f32 (IEEE 754 binary32) are split into words by shifts, the more significant word first
// ("abcd") or last ("cdab"); bytes within a word are Modbus's business (always big-endian).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "config/register_map.hpp"
#include "config/station_config.hpp"

namespace brdfgate {

std::array<std::uint16_t, 2> split_u32(std::uint32_t value, WordOrder order);
std::uint32_t join_u32(std::uint16_t first, std::uint16_t second, WordOrder order);
/// What a PLC may be given: not a number becomes 0, infinities the largest float.
float publishable(double value);

class RegisterImage {
 public:
  /// All zero; covers 0..1004.
  RegisterImage(const RegisterMap& map, WordOrder order);

  /// Writes a u16 (stops at 65535) or u32 (stops at 2^32 - 1) field, or one element of it. Throws
  /// InputError for an unknown name, std::out_of_range for an element that does not exist,
  /// std::logic_error for a field of another type.
  void put(std::string_view key, std::uint64_t value, int instance = 0, int element = 0);
  /// Writes an f32 field as publishable().
  void put_real(std::string_view key, double value, int instance = 0, int element = 0);
  std::uint32_t get(std::string_view key, int instance = 0, int element = 0) const;
  float get_real(std::string_view key, int instance = 0, int element = 0) const;

  std::span<std::uint16_t> words() { return words_; }
  std::span<const std::uint16_t> words() const { return words_; }
  std::span<std::uint16_t> words(const RegisterRange& range);
  std::span<const std::uint16_t> words(const RegisterRange& range) const;

  const RegisterMap& map() const { return *map_; }

 private:
  std::size_t address(std::string_view key, RegisterType type, int instance, int element) const;
  RegisterType type_of(std::string_view key) const { return map_->field(key).type; }

  const RegisterMap* map_;
  WordOrder order_;
  std::vector<std::uint16_t> words_;
};

}  // namespace brdfgate
