#include "app/csv_table.hpp"

#include <algorithm>
#include <fstream>
#include <sstream>

#include "app/number_text.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells;
  std::stringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) {
    const auto first = cell.find_first_not_of(" \t\r\"");
    const auto last = cell.find_last_not_of(" \t\r\"");
    cells.push_back(first == std::string::npos ? "" : cell.substr(first, last - first + 1));
  }
  return cells;
}

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names)
    text += (text.empty() ? "" : ",") + name;
  return text;
}

}  // namespace

CsvTable::CsvTable(const std::filesystem::path& file, const std::vector<std::string>& required)
    : file_(file.string()) {
  std::ifstream in(file);
  if (!in) throw InputError(file_, "cannot be read", "a CSV file");
  int number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    if (line.find_first_not_of(" \t\r") == std::string::npos || line.front() == '#') continue;
    if (!heading_.empty()) {
      rows_.push_back({number, split(line)});
      continue;
    }
    heading_ = split(line);
    for (const std::string& column : required) {
      if (std::find(heading_.begin(), heading_.end(), column) != heading_.end()) continue;
      throw InputError(file_ + ":" + std::to_string(number),
                       "the heading has no column '" + column + "'", joined(required));
    }
  }
  if (rows_.empty()) throw InputError(file_, "holds no row", "a heading and rows of figures");
}

std::string CsvTable::text(std::size_t row, const std::string& column) const {
  const auto at = std::find(heading_.begin(), heading_.end(), column) - heading_.begin();
  const std::vector<std::string>& cells = rows_.at(row).cells;
  return static_cast<std::size_t>(at) < cells.size() ? cells[static_cast<std::size_t>(at)] : "";
}

double CsvTable::number(std::size_t row, const std::string& column) const {
  const std::string cell = text(row, column);
  const auto value = finite_number(cell);
  if (!value) {
    throw InputError(where(row), "'" + cell + "' is no number",
                     "a decimal number in column '" + column + "'");
  }
  return *value;
}

std::string CsvTable::where(std::size_t row) const {
  return file_ + ":" + std::to_string(rows_.at(row).line);
}

}  // namespace brdfgate
