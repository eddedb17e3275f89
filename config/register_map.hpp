// The PLC's register map: one table (modbus_map.csv), embedded when the project is built. The
// register layout of the code, the manual's table and the CSV of PLC symbols all come from it.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace brdfgate {

enum class RegisterType { bit, u16, u32, f32 };

/// The address spaces of the Modbus data model that the map uses. Read-only registers answer to FC
/// 04 and, at the same address, to FC 03; the control block is holding registers only.
inline constexpr int kReadOnlyRegisters = 1000;  ///< 0..999; unassigned ones read 0
inline constexpr int kControlAddress = 1000;
inline constexpr int kControlRegisters = 5;  ///< 1000..1004
inline constexpr int kCoils = 5;
inline constexpr int kDiscretes = 16;
/// Most registers of one read request (Modbus Application Protocol V1.1b3, 6.3).
inline constexpr int kMaxRegistersPerRead = 125;

/// One line of the table.
struct RegisterRow {
  std::string block;
  int address = 0;  ///< zero-based; of the first instance where the block repeats
  RegisterType type = RegisterType::u16;
  int count = 1;  ///< elements
  std::string name;
  bool writable = false;
  std::string meaning;
  int repeat = 1;  ///< instances of the block
  int stride = 0;  ///< registers from one instance to the next

  /// Addresses that one instance takes: registers, or single bits.
  int extent() const;
};

/// Where a field lies.
struct RegisterField {
  int address = 0;
  RegisterType type = RegisterType::u16;
  int count = 1;
};

/// A range of registers that is swapped and read as a whole.
struct RegisterRange {
  int address = 0;
  int count = 0;
};

class RegisterMap {
 public:
  /// The table this program was built with, validated. Throws InputError (a build that fails this
  /// does not pass its tests).
  static const RegisterMap& built_in();
  static const std::string& built_in_csv();

  /// Parses (RFC 4180 quoting, header line required) and validates: known types, unique names,
  /// no overlap within an address space, read-only registers in 0..999, writable ones in the
  /// control block, every block in one read, sequence numbers first and last where there is one.
  /// Throws InputError with `name`:line.
  static RegisterMap parse(const std::string& csv, const std::string& name);

  const std::vector<RegisterRow>& rows() const { return rows_; }

  /// A field by "block.name", e.g. "result.verdict". Throws InputError for an unknown one or an
  /// instance that does not exist.
  RegisterField field(std::string_view key, int instance = 0) const;
  /// From a block's first register to its last. Throws as above.
  RegisterRange block(std::string_view block, int instance = 0) const;
  int instances(std::string_view block) const;

  /// PLC symbols, every repeated instance and array element on its own line:
  /// symbol, table, address, type, access, meaning.
  std::string symbols_csv() const;
  /// The manual's tables.
  std::string markdown() const;

 private:
  RegisterMap() = default;
  std::vector<RegisterRow> rows_;
  std::map<std::string, std::size_t, std::less<>> index_;
};

const char* name_of(RegisterType type);

}  // namespace brdfgate
