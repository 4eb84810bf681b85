#include "fault_tree.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir::bench {
namespace {

// Rates are assumptions, one for each; the arguments say what they stand on.
constexpr std::array kEvents = {
    BasicEvent{"estimator", "none", 0, "every stretch of the flight"},
    BasicEvent{"map", "unchecked_pairs", 1e-3,
               "imagery is registered against another before it is packed, and its CE90 stated"},
    BasicEvent{"estimator", "odometry", 1e-3,
               "focal length or height wrong by 5 %: calibration is checked at the desk"},
    BasicEvent{"estimator", "wrong_anchor", 1e-5, "wrong anchors of a cause that is not in this tree"},
    BasicEvent{"start", "start_500", 1e-3, "one start in a thousand is mistyped or of the last flight"},
    BasicEvent{"start", "start_2000", 1e-3, "likewise"},
    BasicEvent{"map", "other_map", 1e-4, "packages are signed and name their mission; coverage is verified"},
    BasicEvent{"map", "start_and_map", 1e-7, "both at once, independently"},
    BasicEvent{"map", "half_changed", 0.1, "one flight in ten has five minutes over ground that has changed so much"},
    BasicEvent{"map", "map_50", 1e-4, "the imagery's stated CE90 is exceeded tenfold"},
    BasicEvent{"map", "map_200", 1e-5, "a wrong datum or a wrong scene"},
    BasicEvent{"map", "map_1000", 1e-6, "a wrong zone or tile row"},
    BasicEvent{"pictures", "clouds", 1, "five minutes an hour over clouds"},
    BasicEvent{"pictures", "blur", 1, "five minutes an hour out of focus or in rain"},
    BasicEvent{"pictures", "night", 0.1, "one flight in ten runs into the night"},
    BasicEvent{"pictures", "foreign_frames", 1e-3, "a recording or another camera between the frames"},
};
constexpr std::array<std::string_view, 4> kBranches = {"estimator", "start", "map", "pictures"};
constexpr std::array<std::string_view, 4> kBranchNames = {"estimator misleads", "start is wrong", "map is wrong",
                                                          "pictures mislead"};

std::string number(double value) { return value == 0 ? "0" : fmt::format("{:.1e}", value); }

std::string_view name_of(std::string_view code) {
  for (const FaultKind& kind : fault_kinds()) {
    if (kind.code == code) return kind.name;
  }
  return code;
}

std::string verdict(double bound_per_h, double target_per_h) {
  return bound_per_h <= target_per_h ? "reached"
                                     : fmt::format("missed by a factor of {:.2g}", bound_per_h / target_per_h);
}

// ---- Drawing

constexpr double kColumn = 118, kBoxWidth = 106, kBoxHeight = 70, kMargin = 16;

std::string line(double x1, double y1, double x2, double y2) {
  return fmt::format("<line x1='{:.0f}' y1='{:.0f}' x2='{:.0f}' y2='{:.0f}' stroke='#444'/>\n", x1, y1, x2, y2);
}

std::string text(double x, double y, std::string_view what, const char* more = "") {
  std::string escaped;
  for (const char c : what) escaped += c == '<' ? "&lt;" : c == '&' ? "&amp;" : std::string(1, c);
  return fmt::format("<text x='{:.0f}' y='{:.0f}' text-anchor='middle' {}>{}</text>\n", x, y, more, escaped);
}

// Words in lines of a box's width.
std::vector<std::string> wrapped(std::string_view words, std::size_t width) {
  std::vector<std::string> lines(1);
  std::istringstream in{std::string(words)};
  for (std::string word; in >> word;) {
    if (!lines.back().empty() && lines.back().size() + 1 + word.size() > width) lines.emplace_back();
    lines.back() += (lines.back().empty() ? "" : " ") + word;
  }
  return lines;
}

std::string box(double x, double y, double width, double height, const char* fill) {
  return fmt::format("<rect x='{:.0f}' y='{:.0f}' width='{:.0f}' height='{:.0f}' rx='3' fill='{}' stroke='#444'/>\n",
                     x - width / 2, y, width, height, fill);
}

// The shield of an OR gate beneath a box.
std::string or_gate(double x, double y) {
  return fmt::format("<path d='M{0:.0f},{1:.0f} q14,8 14,28 q-14,-8 -28,0 q0,-20 14,-28' fill='#fff' stroke='#444'/>\n",
                     x, y) +
         text(x, y + 20, "≥1", "font-size='10'");
}

}  // namespace

std::span<const BasicEvent> basic_events() { return kEvents; }

FaultTree fault_tree(const std::map<std::string, FaultProbability>& probabilities, double minutes) {
  FaultTree tree;
  tree.minutes = minutes;
  for (const BasicEvent& event : kEvents) {
    const auto found = probabilities.find(std::string(event.fault));
    if (found == probabilities.end()) {
      throw Error({.what = "a basic event has no probability",
                   .found = std::string(event.fault),
                   .fix = "let ./run bench integrity --part splitting run to its end"});
    }
    TreeRow row{event, std::string(name_of(event.fault)), event.rate_per_h > 0 ? event.rate_per_h : 60 / minutes,
                found->second};
    row.hazardous_per_h = row.stretches_per_h * row.probability.hazardous.mean;
    row.hazardous_bound_per_h = row.stretches_per_h * row.probability.hazardous.bound;
    row.misleading_per_h = row.stretches_per_h * row.probability.misleading.mean;
    row.misleading_bound_per_h = row.stretches_per_h * row.probability.misleading.bound;
    tree.hazardous_per_h += row.hazardous_per_h;
    tree.hazardous_bound_per_h += row.hazardous_bound_per_h;
    tree.misleading_per_h += row.misleading_per_h;
    tree.misleading_bound_per_h += row.misleading_bound_per_h;
    tree.rows.push_back(row);
  }
  return tree;
}

std::string tree_table(const FaultTree& tree) {
  std::string table = fmt::format(
      "| basic event | stretches of {:g} minutes in a flight hour (assumed) | because | P(hazardously misleading) | 95 "
      "% "
      "bound | per flight hour | 95 % bound | misleading per flight hour | 95 % bound |\n"
      "|---|---|---|---|---|---|---|---|---|\n",
      tree.minutes);
  for (const TreeRow& r : tree.rows) {
    table += fmt::format("| {} | {:g} | {} | {} | {} | {} | {} | {} | {} |\n", r.name, r.stretches_per_h,
                         r.event.argument, number(r.probability.hazardous.mean), number(r.probability.hazardous.bound),
                         number(r.hazardous_per_h), number(r.hazardous_bound_per_h), number(r.misleading_per_h),
                         number(r.misleading_bound_per_h));
  }
  table += fmt::format("| **top event** | | | | | **{}** | **{}** | {} | {} |\n\n", number(tree.hazardous_per_h),
                       number(tree.hazardous_bound_per_h), number(tree.misleading_per_h),
                       number(tree.misleading_bound_per_h));
  for (const auto& [name, target] : {std::pair{"SAIL III", kSail3_per_h}, std::pair{"SAIL IV", kSail4_per_h}}) {
    table += fmt::format("{}, {:.0e} a flight hour: estimate {}, 95 % bound {}\n", name, target,
                         verdict(tree.hazardous_per_h, target), verdict(tree.hazardous_bound_per_h, target));
  }
  std::vector<TreeRow> rows = tree.rows;
  std::sort(rows.begin(), rows.end(),
            [](const TreeRow& a, const TreeRow& b) { return a.hazardous_bound_per_h > b.hazardous_bound_per_h; });
  table += "limited by: ";
  for (std::size_t i = 0; i < std::min<std::size_t>(3, rows.size()); ++i) {
    table += fmt::format("{}{} ({:.0f} % of the bound)", i == 0 ? "" : ", ", rows[i].name,
                         100 * rows[i].hazardous_bound_per_h / tree.hazardous_bound_per_h);
  }
  return table + "\n";
}

std::string tree_svg(const FaultTree& tree) {
  const auto columns = static_cast<double>(tree.rows.size());
  const double width = 2 * kMargin + kColumn * columns, top_y = 16, branch_y = 130, event_y = 240, height = 452;
  std::string svg = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {:.0f} {:.0f}' font-family='sans-serif' font-size='12'>\n"
      "<rect width='{:.0f}' height='{:.0f}' fill='white'/>\n",
      width, height, width, height);
  const double middle = width / 2, rail_y = branch_y - 16;
  svg += box(middle, top_y, 380, 62, "#f6dcd3");
  svg += text(middle, top_y + 19, "hazardously misleading position", "font-weight='bold'");
  svg += text(middle, top_y + 35, "for longer than the time to alert");
  svg += text(middle, top_y + 53,
              fmt::format("{} per flight hour, 95 % bound {}", number(tree.hazardous_per_h),
                          number(tree.hazardous_bound_per_h)));
  svg += or_gate(middle, top_y + 62);
  double column = 0, first_x = 0, last_x = 0;
  for (std::size_t b = 0; b < kBranches.size(); ++b) {
    std::vector<const TreeRow*> rows;
    double sum = 0, bound = 0;
    for (const TreeRow& row : tree.rows) {
      if (row.event.branch != kBranches[b]) continue;
      rows.push_back(&row);
      sum += row.hazardous_per_h, bound += row.hazardous_bound_per_h;
    }
    const auto count = static_cast<double>(rows.size());
    const double x = kMargin + kColumn * (column + count / 2);
    if (b == 0) first_x = x;
    last_x = x;
    svg += line(x, rail_y, x, branch_y) + box(x, branch_y, 150, 48, "#e8eef4");
    svg += text(x, branch_y + 19, kBranchNames[b], "font-weight='bold'");
    svg += text(x, branch_y + 37, fmt::format("≤ {} / h", number(bound)));
    svg += or_gate(x, branch_y + 48);
    const double rail = event_y - 22;
    svg += line(x, branch_y + 70, x, rail);
    svg += line(kMargin + kColumn * (column + 0.5), rail, kMargin + kColumn * (column + count - 0.5), rail);
    for (const TreeRow* row : rows) {
      const double at = kMargin + kColumn * (column + 0.5);
      svg += line(at, rail, at, event_y) + box(at, event_y, kBoxWidth, kBoxHeight, "#fff");
      double text_y = event_y + 18;
      for (const std::string& words : wrapped(row->name, 15)) {
        svg += text(at, text_y, words);
        text_y += 15;
      }
      svg += line(at, event_y + kBoxHeight, at, event_y + kBoxHeight + 12);
      svg += fmt::format("<circle cx='{:.0f}' cy='{:.0f}' r='46' fill='#f4f4ee' stroke='#444'/>\n", at,
                         event_y + kBoxHeight + 58);
      const double y = event_y + kBoxHeight + 36;
      svg += text(at, y, fmt::format("λ {:.0e} / h", row->stretches_per_h), "font-size='11'");
      svg += text(at, y + 17, fmt::format("P {}", number(row->probability.hazardous.mean)), "font-size='11'");
      svg += text(at, y + 34, fmt::format("≤ {}", number(row->probability.hazardous.bound)), "font-size='11'");
      svg += text(at, y + 51, fmt::format("≤ {} / h", number(row->hazardous_bound_per_h)), "font-size='10'");
      column += 1;
    }
  }
  svg += line(middle, top_y + 84, middle, rail_y) + line(first_x, rail_y, last_x, rail_y);
  svg +=
      text(middle, height - 14,
           fmt::format("λ: stretches of {:g} minutes with the fault, assumed. P: of a hazardously misleading position, "
                       "by splitting; ≤: 95 % bound",
                       tree.minutes),
           "fill='#555'");
  return svg + "</svg>\n";
}

SplittingFile read_splitting(const std::filesystem::path& path, std::uint64_t seed) {
  std::istringstream in(read_text_file(path, std::uint64_t{1} << 28));
  SplittingFile file;
  std::string text;
  std::getline(in, file.run);
  const std::string expected = fmt::format("# nadir bench splitting, base seed {},", seed);
  if (!file.run.starts_with(expected)) {
    throw UsageError({.what = "not the splitting of this base seed",
                      .where = path.string(),
                      .expected = expected,
                      .found = file.run.substr(0, 80),
                      .fix = "pass the --seed of its run, or --from another file"});
  }
  const std::string marker = " particles, ";
  std::istringstream minutes(file.run.substr(file.run.find(marker) + marker.size()));
  minutes >> file.minutes;
  std::getline(in, text);  // names of the columns
  while (std::getline(in, text)) {
    const SplitRecord record = split_record_of(text);
    file.records[record.index] = record;
  }
  return file;
}

}  // namespace nadir::bench
