// The report of a check as files: findings as text, JSON, CSV and Markdown, and one self-contained HTML page with a map
// of coverage and freshness.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "cli/output.hpp"
#include "commands/cache/matchability_request.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"

// The page, embedded by cmake/EmbedText.cmake.
namespace nadir::cache_report_page {

extern const std::string_view html;  // with the places {{title}}, {{style}}, {{data}}, {{script}}
extern const std::string_view style;
extern const std::string_view dom;     // libgeo/report/dom.js
extern const std::string_view script;  // after Leaflet, dom, and base_map.js of map_page

}  // namespace nadir::cache_report_page

namespace nadir {

struct CacheReport {
  std::string title;  // what was checked
  std::string subtitle;
  UtcTime at;  // the time as of which it was evaluated
  Findings findings;
  Figures figures;
  std::optional<Mission> mission;  // without it there is no map
  std::vector<Sidecar> tiles;      // in the order of TileKey
  bool dated = true;               // false: captured_at of the tiles says nothing
  std::optional<MatchabilityResult> matchability = std::nullopt;
  std::optional<VectorLayer> vectors = std::nullopt;
};

// findings.txt, findings.json, findings.csv, findings.md and report.html in `folder`, which is made when it is not
// there. What is there of these names is replaced.
void write_cache_report(const std::filesystem::path& folder, const CacheReport& report);

std::string findings_csv(const Findings& findings);
std::string findings_markdown(const CacheReport& report);
std::string cache_report_html(const CacheReport& report);

}  // namespace nadir
