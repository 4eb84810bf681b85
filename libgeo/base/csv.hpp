// Comma-separated tables with a header row (RFC 4180): read strictly through libcsv, and their cells written.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nadir {

class CsvTable {
 public:
  // Throws Error when the file is missing, empty, not text, or a row has another number of cells than the header.
  static CsvTable read(const std::filesystem::path& path);
  // The same of a text; `name` is for messages.
  static CsvTable parse(std::string_view text, const std::filesystem::path& name);

  std::size_t rows() const { return rows_.size(); }
  const std::vector<std::string>& header() const { return header_; }
  std::optional<std::size_t> column(std::string_view name) const;
  std::size_t required_column(std::string_view name) const;  // throws Error naming the file, the column and the header

  const std::string& cell(std::size_t row, std::size_t column) const { return rows_[row][column]; }
  std::size_t line_of(std::size_t row) const { return lines_[row]; }  // 1-based, as an editor counts
  std::string where(std::size_t row, std::size_t column) const;       // for messages: "map.csv:3, column lat"

  // An empty cell is nullopt. Throws Error for text that is no number and for NaN or infinity.
  std::optional<double> number(std::size_t row, std::size_t column) const;
  double required_number(std::size_t row, std::size_t column) const;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
  std::vector<std::string> header_;
  std::vector<std::vector<std::string>> rows_;
  std::vector<std::size_t> lines_;
};

// Text as a cell: in quotes where it needs them.
std::string csv_cell(std::string_view text);

// Text that others chose, for a person's spreadsheet: always in quotes, and one that begins as a formula does is marked
// as text.
std::string spreadsheet_cell(std::string_view text);

}  // namespace nadir
