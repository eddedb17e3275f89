// SHA-256 (FIPS 180-4), from OpenSSL.
#pragma once

#include <span>
#include <string>

namespace brdfgate {

std::string sha256_hex(std::span<const std::byte> bytes);
std::string sha256_hex(const std::string& text);

}  // namespace brdfgate
