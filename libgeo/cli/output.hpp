// How commands print: findings for people and for programs, figures, counts.
#pragma once

#include <cmath>
#include <cstdint>
#include <iosfwd>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/plural.hpp"
#include "base/time.hpp"

namespace nadir {

// {"accepted": true, "findings": [{code, severity, where, expected, found, fix}]}
nlohmann::json json_from(const Findings& findings);

// Every finding as to_text() gives it, errors first, and a last line with the verdict: "accepted, 1 warning",
// "REJECTED: 2 errors, 1 warning".
void print_findings(std::ostream& out, const Findings& findings);

// `document` as indented UTF-8 with a line end.
void print_json(std::ostream& out, const nlohmann::json& document);

// Findings in the wanted form, and the exit code that follows from them. With JSON, members of `more` (an object or
// null) join the document.
int report_findings(std::ostream& out, bool as_json, const Findings& findings, const nlohmann::json& more);
int report_findings(std::ostream& out, bool as_json, const Findings& findings);

// Two columns: the left one padded to its longest entry. Each figure on one line, whatever it contains.
using Figures = std::vector<std::pair<std::string, std::string>>;
void print_figures(std::ostream& out, const Figures& figures);

// --at when given, else the present time.
UtcTime evaluation_time(const std::optional<UtcTime>& at, const Clock& clock);

// To a whole number of steps, as documents show a figure: rounded(x, 1000) has three decimals.
inline double rounded(double value, double steps = 1000) { return std::round(value * steps) / steps; }

}  // namespace nadir
