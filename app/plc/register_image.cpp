#include "app/plc/register_image.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace brdfgate {

static_assert(std::numeric_limits<float>::is_iec559, "f32 registers are IEEE 754 binary32");

std::array<std::uint16_t, 2> split_u32(std::uint32_t value, WordOrder order) {
  const auto high = static_cast<std::uint16_t>(value >> 16);
  const auto low = static_cast<std::uint16_t>(value & 0xFFFF);
  if (order == WordOrder::cdab) return {low, high};
  return {high, low};
}

std::uint32_t join_u32(std::uint16_t first, std::uint16_t second, WordOrder order) {
  if (order == WordOrder::cdab) std::swap(first, second);
  return std::uint32_t{first} << 16 | second;
}

float publishable(double value) {
  constexpr double kMost = std::numeric_limits<float>::max();
  return std::isnan(value) ? 0.0F : static_cast<float>(std::clamp(value, -kMost, kMost));
}

RegisterImage::RegisterImage(const RegisterMap& map, WordOrder order)
    : map_(&map), order_(order), words_(kControlAddress + kControlRegisters) {}

std::size_t RegisterImage::address(std::string_view key, RegisterType type, int instance,
                                   int element) const {
  const RegisterField field = map_->field(key, instance);
  if (field.type != type) {
    throw std::logic_error("register " + std::string(key) + " is " + name_of(field.type));
  }
  if (element < 0 || element >= field.count) {
    throw std::out_of_range("register " + std::string(key) + " has no element " +
                            std::to_string(element));
  }
  const std::size_t width = type == RegisterType::u16 ? 1 : 2;
  return static_cast<std::size_t>(field.address) + static_cast<std::size_t>(element) * width;
}

void RegisterImage::put(std::string_view key, std::uint64_t value, int instance, int element) {
  if (type_of(key) == RegisterType::u16) {
    words_[address(key, RegisterType::u16, instance, element)] =
        static_cast<std::uint16_t>(std::min<std::uint64_t>(value, 0xFFFF));
    return;
  }
  const std::size_t at = address(key, RegisterType::u32, instance, element);
  const auto capped = static_cast<std::uint32_t>(std::min<std::uint64_t>(value, 0xFFFFFFFF));
  const auto words = split_u32(capped, order_);
  words_[at] = words[0];
  words_[at + 1] = words[1];
}

void RegisterImage::put_real(std::string_view key, double value, int instance, int element) {
  const std::size_t at = address(key, RegisterType::f32, instance, element);
  const auto words = split_u32(std::bit_cast<std::uint32_t>(publishable(value)), order_);
  words_[at] = words[0];
  words_[at + 1] = words[1];
}

std::uint32_t RegisterImage::get(std::string_view key, int instance, int element) const {
  if (type_of(key) == RegisterType::u16) {
    return words_[address(key, RegisterType::u16, instance, element)];
  }
  const std::size_t at = address(key, RegisterType::u32, instance, element);
  return join_u32(words_[at], words_[at + 1], order_);
}

float RegisterImage::get_real(std::string_view key, int instance, int element) const {
  const std::size_t at = address(key, RegisterType::f32, instance, element);
  return std::bit_cast<float>(join_u32(words_[at], words_[at + 1], order_));
}

std::span<std::uint16_t> RegisterImage::words(const RegisterRange& range) {
  return std::span(words_).subspan(static_cast<std::size_t>(range.address),
                                   static_cast<std::size_t>(range.count));
}

std::span<const std::uint16_t> RegisterImage::words(const RegisterRange& range) const {
  return std::span(words_).subspan(static_cast<std::size_t>(range.address),
                                   static_cast<std::size_t>(range.count));
}

}  // namespace brdfgate
