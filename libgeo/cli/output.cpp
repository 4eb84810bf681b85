#include "cli/output.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/printable.hpp"
#include "cli/command.hpp"

namespace nadir {

nlohmann::json json_from(const Findings& findings) {
  auto items = nlohmann::json::array();
  for (const Finding& finding : findings.items()) {
    items.push_back({{"code", finding.code},
                     {"severity", name_of(finding.severity)},
                     {"where", finding.where},
                     {"expected", finding.expected},
                     {"found", finding.found},
                     {"fix", finding.fix}});
  }
  return {{"accepted", !findings.has_errors()}, {"findings", std::move(items)}};
}

namespace {

constexpr std::size_t kShownOfKind = 5;  // findings of one code and severity that are printed one by one

}  // namespace

void print_findings(std::ostream& out, const Findings& findings) {
  std::size_t counts[3] = {};
  std::map<std::pair<Severity, std::string>, std::size_t> kinds;
  for (const Severity severity : {Severity::error, Severity::warning, Severity::note}) {
    for (const Finding& finding : findings.items()) {
      if (finding.severity != severity) continue;
      ++counts[static_cast<std::size_t>(severity)];
      if (++kinds[{severity, finding.code}] <= kShownOfKind) out << to_text(finding) << '\n';
    }
    for (const auto& [kind, number] : kinds) {
      if (kind.first != severity || number <= kShownOfKind) continue;
      out << fmt::format("{}: {} more like these; --json lists all\n", kind.second, number - kShownOfKind);
    }
  }
  const std::size_t errors = counts[static_cast<std::size_t>(Severity::error)];
  const std::size_t warnings = counts[static_cast<std::size_t>(Severity::warning)];
  out << (errors == 0 ? "accepted" : "REJECTED: " + count(errors, "error"));
  if (warnings != 0) out << ", " << count(warnings, "warning");
  out << '\n';
}

void print_json(std::ostream& out, const nlohmann::json& document) {
  out << document.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << '\n';
}

int report_findings(std::ostream& out, bool as_json, const Findings& findings, const nlohmann::json& more) {
  if (as_json) {
    nlohmann::json document = json_from(findings);
    if (more.is_object()) document.update(more);
    print_json(out, document);
  } else {
    print_findings(out, findings);
  }
  return findings.has_errors() ? kRefused : kAccepted;
}

int report_findings(std::ostream& out, bool as_json, const Findings& findings) {
  return report_findings(out, as_json, findings, nlohmann::json());
}

void print_figures(std::ostream& out, const Figures& figures) {
  std::size_t width = 0;
  for (const auto& [name, value] : figures) width = std::max(width, printable(name).size());
  for (const auto& [name, value] : figures) {
    const std::string left = printable(name);
    out << left << std::string(width - left.size() + 2, ' ') << printable(value) << '\n';
  }
}

UtcTime evaluation_time(const std::optional<UtcTime>& at, const Clock& clock) { return at ? *at : clock.now(); }

}  // namespace nadir
