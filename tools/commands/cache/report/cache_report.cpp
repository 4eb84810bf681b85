#include "commands/cache/report/cache_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "commands/cache/report/coverage_map.hpp"
#include "commands/cache/report/report_page.hpp"
#include "cli/nadir_version.hpp"
#include "report/page_text.hpp"

namespace nadir {
namespace {

using nlohmann::json;

// RFC 4180. A spreadsheet takes a cell that begins with = + - @ for a formula: what comes from a file must not be one.
std::string csv_cell(const std::string& text) {
  std::string cell = "\"";
  if (!text.empty() && std::string_view("=+-@\t\r").find(text[0]) != std::string_view::npos) cell += '\'';
  for (const char c : printable(text)) {
    if (c == '"') cell += '"';
    cell += c;
  }
  return cell + '"';
}

// Inside a table of Markdown.
std::string markdown_cell(const std::string& text) {
  std::string cell;
  for (const char c : printable(text)) {
    if (c == '\n') {
      cell += "<br>";
    } else if (c == '<') {
      cell += "&lt;";
    } else {
      if (std::string_view("\\|`*_[]#&").find(c) != std::string_view::npos) cell += '\\';
      cell += c;
    }
  }
  return cell;
}

json document_of(const CacheReport& report) {
  json document = json_from(report.findings);
  document["subject"] = report.title;
  document["judged_at"] = to_rfc3339(report.at);
  json& figures = document["figures"] = json::array();
  for (const auto& [name, value] : report.figures) figures.push_back({{"name", name}, {"value", value}});
  return document;
}

std::string findings_text(const CacheReport& report) {
  std::ostringstream out;
  print_figures(out, report.figures);
  out << "judged at " << to_rfc3339(report.at) << "\n\n";
  print_findings(out, report.findings);
  return printable(out.str());
}

}  // namespace

std::string findings_csv(const Findings& findings) {
  std::string csv = "code,severity,where,expected,found,fix\r\n";
  for (const Finding& finding : findings.items()) {
    csv += fmt::format("{},{},{},{},{},{}\r\n", csv_cell(finding.code),
                       csv_cell(std::string(name_of(finding.severity))), csv_cell(finding.where),
                       csv_cell(finding.expected), csv_cell(finding.found), csv_cell(finding.fix));
  }
  return csv;
}

std::string findings_markdown(const CacheReport& report) {
  std::string text = fmt::format("# {}\n\n**{}**, judged at {}.\n\n", markdown_cell(report.title),
                                 report.findings.refuses() ? "Refused" : "Accepted", to_rfc3339(report.at));
  text += "| | |\n|---|---|\n";
  for (const auto& [name, value] : report.figures) {
    text += fmt::format("| {} | {} |\n", markdown_cell(name), markdown_cell(value));
  }
  if (report.findings.empty()) return text + "\nNo findings.\n";
  text += "\n| code | severity | where | expected | found | fix |\n|---|---|---|---|---|---|\n";
  for (const Finding& finding : report.findings.items()) {
    text += fmt::format("| {} | {} | {} | {} | {} | {} |\n", markdown_cell(finding.code), name_of(finding.severity),
                        markdown_cell(finding.where), markdown_cell(finding.expected), markdown_cell(finding.found),
                        markdown_cell(finding.fix));
  }
  return text;
}

std::string cache_report_html(const CacheReport& report) {
  json data = document_of(report);
  data["title"] = report.title;
  data["subtitle"] = report.subtitle;
  data["generator"] = fmt::format("Made by nadir {}", kVersion);
  data["map"] = report.mission ? coverage_map(report) : json();
  const std::string text = script_safe(data), title = html_escaped(report.title);
  return fill_page(
      cache_report_page::html,
      {{"title", title}, {"style", cache_report_page::style}, {"data", text}, {"script", cache_report_page::script}});
}

void write_cache_report(const std::filesystem::path& folder, const CacheReport& report) {
  std::error_code problem;
  std::filesystem::create_directories(folder, problem);
  if (problem || !std::filesystem::is_directory(folder)) {
    throw Error({.what = "the report's folder cannot be made",
                 .where = folder.string(),
                 .found = problem ? problem.message() : "something else of this name",
                 .fix = "name another folder for --report"});
  }
  const std::string document = document_of(report).dump(2, ' ', false, json::error_handler_t::replace) + "\n";
  write_file_atomic(folder / "findings.txt", findings_text(report));
  write_file_atomic(folder / "findings.json", document);
  write_file_atomic(folder / "findings.csv", findings_csv(report.findings));
  write_file_atomic(folder / "findings.md", findings_markdown(report));
  write_file_atomic(folder / "report.html", cache_report_html(report));
}

}  // namespace nadir
