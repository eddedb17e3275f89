#include "config/register_map.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <set>
#include <utility>

#include "model/error.hpp"

namespace brdfgate {

extern const char* const kModbusMapCsv;  // made by CMake from modbus_map.csv

namespace {

constexpr std::array<std::pair<RegisterType, const char*>, 4> kTypeNames{
    {{RegisterType::bit, "bit"},
     {RegisterType::u16, "u16"},
     {RegisterType::u32, "u32"},
     {RegisterType::f32, "f32"}}};

constexpr const char* kHeader = "block,address,type,count,name,access,meaning";

std::string place(const std::string& name, std::size_t line) {
  return name + ":" + std::to_string(line);
}

/// Fields of one line, RFC 4180: a quoted field may hold commas and doubled quotes.
std::vector<std::string> split_csv(const std::string& line) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (quoted && c == '"' && i + 1 < line.size() && line[i + 1] == '"') {
      fields.back() += line[++i];
    } else if (c == '"') {
      quoted = !quoted;
    } else if (c == ',' && !quoted) {
      fields.emplace_back();
    } else {
      fields.back() += c;
    }
  }
  return fields;
}

std::string quote_csv(const std::string& text) {
  if (text.find_first_of(",\"") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text)
    out += c == '"' ? "\"\"" : std::string(1, c);
  return out + '"';
}

int parse_int(const std::string& text, const std::string& where, const char* field) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < 0) {
    throw InputError(where, std::string(field) + " is '" + text + "'", "a whole number from 0");
  }
  return value;
}

RegisterType parse_type(const std::string& text, const std::string& where) {
  for (const auto& [type, name] : kTypeNames) {
    if (text == name) return type;
  }
  throw InputError(where, "type is '" + text + "'", "bit, u16, u32 or f32");
}

/// "name" or "name x8 +100": eight instances, 100 registers apart.
void parse_block(const std::string& text, const std::string& where, RegisterRow& row) {
  const std::size_t times = text.find(" x");
  row.block = text.substr(0, times);
  if (times == std::string::npos) return;
  const std::size_t plus = text.find(" +", times);
  if (plus == std::string::npos) {
    throw InputError(where, "block is '" + text + "'", "'name' or 'name xCOUNT +STRIDE'");
  }
  row.repeat = parse_int(text.substr(times + 2, plus - times - 2), where, "block's count");
  row.stride = parse_int(text.substr(plus + 2), where, "block's stride");
}

RegisterRow parse_row(const std::string& line, const std::string& where) {
  const std::vector<std::string> fields = split_csv(line);
  if (fields.size() != 7) {
    throw InputError(where, std::to_string(fields.size()) + " fields", kHeader);
  }
  RegisterRow row;
  parse_block(fields[0], where, row);
  row.address = parse_int(fields[1], where, "address");
  row.type = parse_type(fields[2], where);
  row.count = parse_int(fields[3], where, "count");
  row.name = fields[4];
  row.writable = fields[5] == "rw";
  row.meaning = fields[6];
  if (!row.writable && fields[5] != "r") {
    throw InputError(where, "access is '" + fields[5] + "'", "r or rw");
  }
  if (row.block.empty() || row.name.empty() || row.count < 1 || row.repeat < 1) {
    throw InputError(where, "empty block or name, or a count of 0");
  }
  return row;
}

enum class Space { registers, coils, discretes };
Space space_of(const RegisterRow& row) {
  if (row.type != RegisterType::bit) return Space::registers;
  return row.writable ? Space::coils : Space::discretes;
}

/// Where rows of this kind must lie: [first, last).
std::pair<int, int> bounds_of(const RegisterRow& row) {
  switch (space_of(row)) {
    case Space::coils:
      return {0, kCoils};
    case Space::discretes:
      return {0, kDiscretes};
    case Space::registers:
      break;
  }
  return row.writable ? std::pair{kControlAddress, kControlAddress + kControlRegisters}
                      : std::pair{0, kReadOnlyRegisters};
}

/// Addresses taken so far, per space; refuses what is out of bounds or taken twice.
class Occupancy {
 public:
  void take(const RegisterRow& row, const std::string& where) {
    const auto [first, last] = bounds_of(row);
    auto& taken = taken_[static_cast<std::size_t>(space_of(row))];
    for (int instance = 0; instance < row.repeat; ++instance) {
      const int start = row.address + instance * row.stride;
      if (start < first || start + row.extent() > last) {
        throw InputError(where, row.name + " at " + std::to_string(start) + " is out of range",
                         std::to_string(first) + " to " + std::to_string(last - 1));
      }
      for (int a = start; a < start + row.extent(); ++a) {
        if (!taken.insert(a).second) {
          throw InputError(where, row.name + " overlaps another field at " + std::to_string(a));
        }
      }
    }
  }

 private:
  std::array<std::set<int>, 3> taken_;
};

/// A block that carries a sequence number carries it first and last.
void check_block(const RegisterMap& map, const std::string& block, const std::string& name) {
  const RegisterRange range = map.block(block);
  if (range.count > kMaxRegistersPerRead) {
    throw InputError(name,
                     "block " + block + " takes " + std::to_string(range.count) + " registers",
                     "at most 125, so that one read holds it");
  }
  const auto has = [&](const std::string& field) {
    return std::any_of(map.rows().begin(), map.rows().end(), [&](const RegisterRow& row) {
      return row.block == block && row.name == field;
    });
  };
  if (!has("seq_head") && !has("seq_tail")) return;
  const bool framed = has("seq_head") && has("seq_tail") &&
                      map.field(block + ".seq_head").address == range.address &&
                      map.field(block + ".seq_tail").address == range.address + range.count - 2;
  if (!framed) {
    throw InputError(name, "block " + block + " has its sequence number elsewhere",
                     "seq_head first and seq_tail last");
  }
}

std::string markdown_row(const RegisterRow& row) {
  std::string type = name_of(row.type);
  if (row.count > 1) type += "[" + std::to_string(row.count) + "]";
  const std::string address =
      row.repeat > 1 ? std::to_string(row.address) + " + " + std::to_string(row.stride) + " c"
                     : std::to_string(row.address);
  return "| " + address + " | " + type + " | " + row.name + " | " + row.meaning + " |\n";
}

std::string title_of(const RegisterRow& row) {
  if (row.repeat > 1) {
    return row.block + " c = 0.." + std::to_string(row.repeat - 1) +
           " (input registers, FC 04 or 03)";
  }
  switch (space_of(row)) {
    case Space::coils:
      return row.block + " (coils, FC 01, 05 and 15)";
    case Space::discretes:
      return row.block + " (discrete inputs, FC 02)";
    case Space::registers:
      break;
  }
  return row.block + (row.writable ? " (holding registers, FC 03, 06 and 16)"
                                   : " (input registers, FC 04 or 03)");
}

std::string table_of(const RegisterRow& row) {
  switch (space_of(row)) {
    case Space::coils:
      return "coil";
    case Space::discretes:
      return "discrete";
    case Space::registers:
      break;
  }
  return row.writable ? "holding" : "input";
}

}  // namespace

int RegisterRow::extent() const {
  const bool two = type == RegisterType::u32 || type == RegisterType::f32;
  return two ? 2 * count : count;
}

const char* name_of(RegisterType type) {
  return kTypeNames[static_cast<std::size_t>(type)].second;
}

const std::string& RegisterMap::built_in_csv() {
  static const std::string csv = kModbusMapCsv;
  return csv;
}

const RegisterMap& RegisterMap::built_in() {
  static const RegisterMap map = parse(built_in_csv(), "modbus_map.csv");
  return map;
}

RegisterMap RegisterMap::parse(const std::string& csv, const std::string& name) {
  RegisterMap map;
  Occupancy occupancy;
  std::size_t line_number = 0;
  for (std::size_t start = 0; start < csv.size();) {
    const std::size_t end = std::min(csv.find('\n', start), csv.size());
    const std::string line = csv.substr(start, end - start);
    start = end + 1;
    const std::string where = place(name, ++line_number);
    if (line_number == 1) {
      if (line != kHeader) throw InputError(where, "header is '" + line + "'", kHeader);
      continue;
    }
    if (line.empty()) continue;
    RegisterRow row = parse_row(line, where);
    occupancy.take(row, where);
    if (!map.index_.emplace(row.block + "." + row.name, map.rows_.size()).second) {
      throw InputError(where, row.block + "." + row.name + " is named twice");
    }
    map.rows_.push_back(std::move(row));
  }
  if (map.rows_.empty()) throw InputError(name, "no rows", kHeader);
  std::set<std::string> blocks;
  for (const RegisterRow& row : map.rows_) {
    if (blocks.insert(row.block).second) check_block(map, row.block, name);
  }
  return map;
}

RegisterField RegisterMap::field(std::string_view key, int instance) const {
  const auto found = index_.find(key);
  if (found == index_.end() || instance < 0 || instance >= rows_[found->second].repeat) {
    throw InputError("register map",
                     "no field '" + std::string(key) + "', instance " + std::to_string(instance));
  }
  const RegisterRow& row = rows_[found->second];
  return {row.address + instance * row.stride, row.type, row.count};
}

RegisterRange RegisterMap::block(std::string_view block, int instance) const {
  std::optional<int> first;
  int last = 0;
  for (const RegisterRow& row : rows_) {
    if (row.block != block || instance < 0 || instance >= row.repeat) continue;
    const int start = row.address + instance * row.stride;
    first = std::min(first.value_or(start), start);
    last = std::max(last, start + row.extent());
  }
  if (!first) throw InputError("register map", "no block '" + std::string(block) + "'");
  return {*first, last - *first};
}

int RegisterMap::instances(std::string_view block) const {
  for (const RegisterRow& row : rows_) {
    if (row.block == block) return row.repeat;
  }
  throw InputError("register map", "no block '" + std::string(block) + "'");
}

std::string RegisterMap::symbols_csv() const {
  std::string out = "symbol,table,address,type,access,meaning\n";
  for (const RegisterRow& row : rows_) {
    const int width = row.extent() / row.count;
    for (int i = 0; i < row.repeat * row.count; ++i) {
      const int instance = i / row.count;
      const int element = i % row.count;
      const std::string block = row.repeat > 1 ? row.block + std::to_string(instance) : row.block;
      const std::string symbol =
          block + "_" + row.name + (row.count > 1 ? "_" + std::to_string(element) : "");
      const int address = row.address + instance * row.stride + element * width;
      out += symbol + "," + table_of(row) + "," + std::to_string(address) + "," +
             name_of(row.type) + "," + (row.writable ? "rw" : "r") + "," + quote_csv(row.meaning) +
             "\n";
    }
  }
  return out;
}

std::string RegisterMap::markdown() const {
  std::string out;
  std::string block;
  for (const RegisterRow& row : rows_) {
    if (row.block != block) {
      block = row.block;
      out += (out.empty() ? "### " : "\n### ") + title_of(row) +
             "\n\n| address | type | name | meaning |\n| --- | --- | --- | --- |\n";
    }
    out += markdown_row(row);
  }
  return out;
}

}  // namespace brdfgate
