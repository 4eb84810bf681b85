#include "base/csv.hpp"

#include <csv.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <memory>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/number_text.hpp"

namespace nadir {
namespace {

struct Parse {
  std::vector<std::string> row;
  std::vector<std::vector<std::string>> rows;
  std::vector<std::size_t> lines;
  std::size_t line = 1;
};

void on_cell(void* text, size_t size, void* user) {
  static_cast<Parse*>(user)->row.emplace_back(static_cast<const char*>(text), size);
}

void on_row(int, void* user) {
  auto& parse = *static_cast<Parse*>(user);
  parse.rows.push_back(std::move(parse.row));
  parse.row.clear();
  parse.lines.push_back(parse.line);
}

Parse parse_csv(const std::filesystem::path& path, std::string_view text) {
  csv_parser parser{};
  if (csv_init(&parser, CSV_STRICT | CSV_STRICT_FINI | CSV_APPEND_NULL) != 0) {
    throw Error({.what = "out of memory for reading a table", .where = path});
  }
  const std::unique_ptr<csv_parser, decltype(&csv_free)> owner(&parser, &csv_free);
  Parse parse;
  const auto check = [&](bool ok) {
    if (ok) return;
    throw Error({.what = "cannot read a table",
                 .where = fmt::format("{}:{}", path.string(), parse.line),
                 .expected = "comma-separated values (RFC 4180)",
                 .found = csv_strerror(csv_error(&parser)),
                 .fix = "look for an unmatched quote on or before this line"});
  };
  // Line by line, so that errors and rows know their line; quoted line breaks stay inside one row.
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size() - 1) + 1;
    check(csv_parse(&parser, text.data(), end, on_cell, on_row, &parse) == end);
    text.remove_prefix(end);
    ++parse.line;
  }
  --parse.line;  // a row that no line break ends
  check(csv_fini(&parser, on_cell, on_row, &parse) == 0);
  return parse;
}

std::string in_quotes(const std::string& text) {
  std::string cell(csv_write(nullptr, 0, text.data(), text.size()), '\0');
  csv_write(cell.data(), cell.size(), text.data(), text.size());
  return cell;
}

}  // namespace

CsvTable CsvTable::read(const std::filesystem::path& path) { return parse(read_text_file(path), path); }

CsvTable CsvTable::parse(std::string_view body, const std::filesystem::path& path) {
  if (body.starts_with("\xEF\xBB\xBF")) body.remove_prefix(3);
  if (body.find('\0') != std::string_view::npos) {
    throw Error({.what = "cannot read a table", .where = path, .expected = "text", .found = "binary data"});
  }
  Parse parse = parse_csv(path, body);
  if (parse.rows.empty()) {
    throw Error({.what = "the table is empty", .where = path, .expected = "a header row and at least one more"});
  }
  CsvTable table;
  table.path_ = path;
  table.header_ = std::move(parse.rows.front());
  for (std::size_t i = 1; i < parse.rows.size(); ++i) {
    if (parse.rows[i].size() != table.header_.size()) {
      throw Error({.what = "a row has the wrong number of cells",
                   .where = fmt::format("{}:{}", path.string(), parse.lines[i]),
                   .expected = fmt::format("{} cells as in the header", table.header_.size()),
                   .found = fmt::format("{} cells", parse.rows[i].size())});
    }
    table.rows_.push_back(std::move(parse.rows[i]));
    table.lines_.push_back(parse.lines[i]);
  }
  return table;
}

std::optional<std::size_t> CsvTable::column(std::string_view name) const {
  const auto found = std::find(header_.begin(), header_.end(), name);
  if (found == header_.end()) return std::nullopt;
  return static_cast<std::size_t>(found - header_.begin());
}

std::size_t CsvTable::required_column(std::string_view name) const {
  if (const auto index = column(name)) return *index;
  throw Error({.what = "a column is missing",
               .where = path_,
               .expected = fmt::format("a column \"{}\"", name),
               .found = fmt::format("{}", fmt::join(header_, ", "))});
}

std::string CsvTable::where(std::size_t row, std::size_t column) const {
  return fmt::format("{}:{}, column {}", path_.string(), line_of(row), header_[column]);
}

std::optional<double> CsvTable::number(std::size_t row, std::size_t column) const {
  std::string_view text = cell(row, column);
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  if (text.empty()) return std::nullopt;
  const auto value = finite_number(text);
  if (!value) {
    throw Error({.what = "a cell does not hold a number",
                 .where = where(row, column),
                 .expected = "a finite number, or nothing where the value is unknown",
                 .found = fmt::format("\"{}\"", text)});
  }
  return value;
}

double CsvTable::required_number(std::size_t row, std::size_t column) const {
  if (const auto value = number(row, column)) return *value;
  throw Error({.what = "a cell is empty that must hold a number", .where = where(row, column)});
}

std::string csv_cell(std::string_view text) {
  const std::string cell(text);
  return text.find_first_of(",\"\n\r") == std::string_view::npos ? cell : in_quotes(cell);
}

std::string spreadsheet_cell(std::string_view text) {
  const bool formula = !text.empty() && std::string_view("=+-@\t\r").find(text.front()) != std::string_view::npos;
  return in_quotes((formula ? "'" : "") + std::string(text));
}

}  // namespace nadir
