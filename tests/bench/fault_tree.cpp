#include "fault_tree.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "counted_share.hpp"

namespace nadir::bench {
namespace {

// Rates are assumptions, one for each; the arguments say what they stand on.
constexpr std::array kEvents = {
    BasicEvent{"estimator", "none", 0, "every stretch of the flight"},
    BasicEvent{"estimator", "odometry", 1e-3,
               "focal length or height wrong by 5 %: calibration is checked at the desk"},
    BasicEvent{"estimator", "wrong_anchor", 1e-5, "wrong anchors of a cause that is not in this tree"},
    BasicEvent{"estimator", "wrong_motion", 0.02,
               "one motion in 1818 where frames hardly overlap, 280 motions an hour, one flight in ten"},
    BasicEvent{"start", "start_500", 1e-3, "one start in a thousand is mistyped or of the last flight"},
    BasicEvent{"start", "start_2000", 1e-3, "likewise"},
    BasicEvent{"map", "unchecked_pairs", 1e-3,
               "imagery is registered against another before it is packed, and its CE90 stated"},
    BasicEvent{"map", "half_changed", 0.1, "one flight in ten has five minutes over ground that has changed so much"},
    BasicEvent{"map", "other_map", 1e-4, "packages are signed and name their mission; coverage is verified"},
    BasicEvent{"map", "start_and_map", 1e-7, "both at once, independently"},
    BasicEvent{"map", "map_50", 1e-4, "the imagery's stated CE90 is exceeded tenfold"},
    BasicEvent{"map", "map_200", 1e-5, "a wrong datum or a wrong scene"},
    BasicEvent{"map", "map_1000", 1e-6, "a wrong zone or tile row"},
    BasicEvent{"pictures", "clouds", 1, "five minutes an hour over clouds"},
    BasicEvent{"pictures", "blur", 1, "five minutes an hour out of focus or in rain"},
    BasicEvent{"pictures", "night", 0.1, "one flight in ten runs into the night"},
    BasicEvent{"pictures", "foreign_frames", 1e-3, "a recording or another camera between the frames"},
};
constexpr double kStartsPerHour = 1;
constexpr int kOftenEnough = 3;  // plain flights that met an event: the bound of a count is then 2.9 times its share
constexpr std::array<std::string_view, 4> kBranches = {"estimator", "start", "map", "pictures"};
constexpr std::array<std::string_view, 4> kBranchNames = {"estimator misleads", "start is wrong", "map is wrong",
                                                          "pictures mislead"};

std::string number(double value) { return value == 0 ? "0" : fmt::format("{:.1e}", value); }

// What plain flights met often enough has their share as its probability, and the bound of a count: there is nothing
// that a method may miss, and no few repetitions carry most of it.
SplitEstimate counted_or_split(int met, int flights, const SplitEstimate& split) {
  if (met < kOftenEnough) return split;
  const CountedShare share{met, flights};
  return {share.share(), share.upper(), split.levels, split.repetitions};
}

// Of two estimates, by shares that add up to one.
SplitEstimate mean_of(const SplitEstimate& one, double share, const SplitEstimate& other) {
  return {share * one.mean + (1 - share) * other.mean, share * one.bound + (1 - share) * other.bound,
          share * one.levels + (1 - share) * other.levels, std::min(one.repetitions, other.repetitions)};
}

// Of a stretch of flight, wherever in the hour it lies.
EventProbability probability_of(std::string_view fault, double stretches_per_h,
                                const std::map<std::string, FaultProbability>& probabilities) {
  const auto simulated = [&](const FaultKind& kind) -> const FaultProbability& {
    const auto found = probabilities.find(kind.code);
    if (found != probabilities.end()) return found->second;
    throw Error({.what = "a basic event has no probability",
                 .found = kind.code,
                 .fix = "let ./run bench integrity --part splitting run to its end"});
  };
  const auto of = [&](const FaultKind& kind) -> EventProbability {
    const FaultProbability& p = simulated(kind);
    return {counted_or_split(p.plain.misleading, p.plain.flights, p.misleading),
            counted_or_split(p.plain.hazardous, p.plain.flights, p.hazardous)};
  };
  const FaultKind& at_start = fault_kind(fault);
  const EventProbability first = of(at_start);
  for (const FaultKind& kind : fault_kinds()) {
    if (kind.fault != at_start.fault || kind.onset == Onset::start) continue;
    const EventProbability later = of(kind);
    const double share = kStartsPerHour / stretches_per_h;
    return {mean_of(first.misleading, share, later.misleading), mean_of(first.hazardous, share, later.hazardous)};
  }
  return first;
}

std::string verdict(double bound_per_h, double target_per_h) {
  return bound_per_h <= target_per_h ? "reached"
                                     : fmt::format("missed by a factor of {:.2g}", bound_per_h / target_per_h);
}

// ---- Drawing: from the top event on the left to the basic events, a row each

constexpr double kRow = 30, kTop = 74, kWidth = 990;
constexpr double kTopX = 8, kTopWidth = 172, kBranchX = 224, kBranchWidth = 140, kEventX = 420;
constexpr double kRateX = 726, kProbabilityX = 802, kScaleX = 818, kScaleEnd = 976;
constexpr double kLeastPower = -12, kMostPower = 0;  // of the scale

std::string line(double x1, double y1, double x2, double y2, const char* more = "stroke='#444'") {
  return fmt::format("<line x1='{:.1f}' y1='{:.1f}' x2='{:.1f}' y2='{:.1f}' {}/>\n", x1, y1, x2, y2, more);
}

std::string text(double x, double y, std::string_view what, const char* anchor, const char* more = "") {
  std::string escaped;
  for (const char c : what) escaped += c == '<' ? "&lt;" : c == '&' ? "&amp;" : std::string(1, c);
  return fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='{}' {}>{}</text>\n", x, y, anchor, more, escaped);
}

std::string box(double x, double y, double width, double height, const char* fill) {
  return fmt::format("<rect x='{:.1f}' y='{:.1f}' width='{:.1f}' height='{:.1f}' rx='3' fill='{}' stroke='#444'/>\n", x,
                     y - height / 2, width, height, fill);
}

// To the right of a box, and the lines to what it joins.
std::string or_gate(double x, double y, const std::vector<double>& inputs, double inputs_x) {
  const double rail = x + 36;
  std::string svg = fmt::format(
      "<path d='M{0:.1f},{1:.1f} q8,-14 28,-14 q-8,14 0,28 q-20,0 -28,-14' fill='#fff' stroke='#444'/>\n", x, y);
  svg += text(x + 14, y + 4, "≥1", "middle", "font-size='10'") + line(x + 24, y, rail, y);
  svg += line(rail, std::min(y, inputs.front()), rail, std::max(y, inputs.back()));
  for (const double input : inputs) svg += line(rail, input, inputs_x, input);
  return svg;
}

double scale_x(double rate_per_h) {
  const double power = std::clamp(std::log10(std::max(rate_per_h, 1e-30)), kLeastPower, kMostPower);
  return kScaleX + (kScaleEnd - kScaleX) * (power - kLeastPower) / (kMostPower - kLeastPower);
}

}  // namespace

std::span<const BasicEvent> basic_events() { return kEvents; }

FaultTree fault_tree(const std::map<std::string, FaultProbability>& probabilities, double minutes) {
  FaultTree tree;
  tree.minutes = minutes;
  for (const BasicEvent& event : kEvents) {
    const double stretches_per_h = 60 / minutes;
    TreeRow row{event, fault_kind(event.fault).name, event.rate_per_h > 0 ? event.rate_per_h : stretches_per_h,
                probability_of(event.fault, stretches_per_h, probabilities)};
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
  const double height = kTop + kRow * static_cast<double>(tree.rows.size()) + 44, bottom = height - 40;
  std::string svg = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {0:.0f} {1:.0f}' font-family='sans-serif' font-size='12'>\n"
      "<rect width='{0:.0f}' height='{1:.0f}' fill='white'/>\n",
      kWidth, height);
  svg += text(kRateX, kTop - 22, "λ, 1/h", "end", "fill='#555'") +
         text(kProbabilityX, kTop - 22, "P(hazard)", "end", "fill='#555'") +
         text(kScaleEnd, 20, "rate of the top event, 1/h:", "end", "fill='#555'") +
         text(kScaleEnd, 35, "bar estimate, line 95 % bound", "end", "fill='#555'");
  for (const double power : {-12.0, -10.0, -8.0, -6.0, -4.0, -2.0, 0.0}) {
    svg += text(scale_x(std::pow(10, power)), kTop - 22, fmt::format("{:g}", power), "middle",
                "fill='#555' font-size='10'");
  }
  for (const double target : {kSail3_per_h, kSail4_per_h}) {
    svg += line(scale_x(target), kTop - 16, scale_x(target), bottom, "stroke='#a33' stroke-dasharray='4 3'");
  }
  double y = kTop;
  std::vector<double> branches;
  for (std::size_t b = 0; b < kBranches.size(); ++b) {
    std::vector<double> events;
    double bound = 0;
    for (const TreeRow& row : tree.rows) {
      if (row.event.branch != kBranches[b]) continue;
      bound += row.hazardous_bound_per_h;
      svg += fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='6' fill='#f4f4ee' stroke='#444'/>\n", kEventX, y);
      svg += text(kEventX + 14, y + 4, row.name, "start") +
             text(kRateX, y + 4, fmt::format("{:g}", row.stretches_per_h), "end") +
             text(kProbabilityX, y + 4, number(row.probability.hazardous.mean), "end");
      const double end = scale_x(row.hazardous_per_h);
      svg += fmt::format("<rect x='{:.1f}' y='{:.1f}' width='{:.1f}' height='12' fill='#6d94b8'/>\n", kScaleX, y - 6,
                         end - kScaleX);
      svg += line(end, y, scale_x(row.hazardous_bound_per_h), y, "stroke='#1b4f72' stroke-width='2'");
      events.push_back(y);
      y += kRow;
    }
    const double middle = (events.front() + events.back()) / 2;
    svg += box(kBranchX, middle, kBranchWidth, 44, "#e8eef4");
    svg += text(kBranchX + kBranchWidth / 2, middle - 4, kBranchNames[b], "middle", "font-weight='bold'");
    svg += text(kBranchX + kBranchWidth / 2, middle + 13, fmt::format("≤ {} / h", number(bound)), "middle");
    svg += or_gate(kBranchX + kBranchWidth, middle, events, kEventX - 6);
    branches.push_back(middle);
  }
  const double middle = (branches.front() + branches.back()) / 2, centre = kTopX + kTopWidth / 2;
  svg += box(kTopX, middle, kTopWidth, 104, "#f6dcd3");
  double at = middle - 32;
  for (const char* words : {"hazardously misleading", "position, longer than", "the time to alert"}) {
    svg += text(centre, at, words, "middle", "font-weight='bold'");
    at += 16;
  }
  svg += text(centre, at + 6, fmt::format("{} / h", number(tree.hazardous_per_h)), "middle");
  svg += text(centre, at + 22, fmt::format("95 % bound {}", number(tree.hazardous_bound_per_h)), "middle");
  svg += or_gate(kTopX + kTopWidth, middle, branches, kBranchX);
  svg += text(
      kTopX, height - 12,
      fmt::format(
          "λ: stretches of {:g} minutes with the fault in a flight hour, assumed. P: counted or by splitting. Scale: "
          "powers of ten; dashed: 1e-5 and 1e-4.",
          tree.minutes),
      "start", "fill='#555'");
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
