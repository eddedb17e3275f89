// Tables people keep in CSV files: a heading, then rows; blank lines and lines that begin with # do
// not count, blanks and quotes around a cell neither.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace brdfgate {

class CsvTable {
 public:
  /// Throws InputError: no such file, no heading, no row, a column of `required` that is missing.
  CsvTable(const std::filesystem::path& file, const std::vector<std::string>& required);

  std::size_t rows() const { return rows_.size(); }
  /// Empty where the row or the heading has no such column.
  std::string text(std::size_t row, const std::string& column) const;
  /// Throws InputError with file and line.
  double number(std::size_t row, const std::string& column) const;
  /// "file:line" of a row.
  std::string where(std::size_t row) const;

 private:
  struct Row {
    int line = 0;
    std::vector<std::string> cells;
  };
  std::string file_;
  std::vector<std::string> heading_;
  std::vector<Row> rows_;
};

}  // namespace brdfgate
