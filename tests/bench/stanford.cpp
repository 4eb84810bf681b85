#include "stanford.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <sstream>

#include "base/error.hpp"

namespace nadir::bench {
namespace {

// Both axes are logarithmic, from 1 m to 1 km.
constexpr double kLeft = 70, kTop = 40, kSide = 420, kDecades = 3;
constexpr double kCell = 0.04;  // side of a cell in which points are counted together, in decades

double along(double metres) { return std::clamp(std::log10(std::max(metres, 1e-9)), 0.0, kDecades) / kDecades; }
double x_of(double error_m) { return kLeft + kSide * along(error_m); }
double y_of(double hpl_m) { return kTop + kSide * (1 - along(hpl_m)); }

std::string text(double x, double y, std::string_view what, const char* anchor, const std::string& more = "") {
  return fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='{}' {}>{}</text>\n", x, y, anchor, more, what);
}

std::string region(std::string_view points, const char* fill) {
  return fmt::format("<polygon points='{}' fill='{}'/>\n", points, fill);
}

std::string regions() {
  const double limit_x = x_of(kAlertLimit_m), limit_y = y_of(kAlertLimit_m), right = kLeft + kSide,
               bottom = kTop + kSide;
  return region(fmt::format("{0},{1} {0},{2:.1f} {3:.1f},{2:.1f}", kLeft, bottom, limit_y, limit_x), "#e6f2e3") +
         region(fmt::format("{0},{1} {2:.1f},{3:.1f} {2:.1f},{1}", kLeft, bottom, limit_x, limit_y), "#f8ecd0") +
         region(fmt::format("{0:.1f},{1} {0:.1f},{2:.1f} {3},{2:.1f} {3},{1}", limit_x, bottom, limit_y, right),
                "#f4cfc6") +
         region(fmt::format("{0},{1} {0},{2:.1f} {3:.1f},{2:.1f} {4},{1}", kLeft, kTop, limit_y, limit_x, right),
                "#eeeeee") +
         region(fmt::format("{0},{1} {0},{2:.1f} {3:.1f},{2:.1f}", right, kTop, limit_y, limit_x), "#e2e0e6");
}

std::string percent(const CountedShare& share, bool bounds) {
  if (share.of == 0) return "-";
  if (!bounds) return fmt::format("{:.1f}", 100 * share.share());
  return fmt::format("{} ({:.2g} to {:.2g} %)", share.count, 100 * share.lower(), 100 * share.upper());
}

}  // namespace

std::string levels_text(const std::vector<LeveledError>& levels) {
  std::string text;
  for (const LeveledError& l : levels) {
    text += fmt::format("{}{:.2f}/{:.2f}", text.empty() ? "" : " ", l.error_m, l.hpl_m);
  }
  return text;
}

std::vector<LeveledError> levels_of(const std::string& text) {
  std::vector<LeveledError> levels;
  std::istringstream in(text);
  for (std::string cell; in >> cell;) {
    std::istringstream pair(cell);
    LeveledError level;
    char slash = 0;
    if (!(pair >> level.error_m >> slash >> level.hpl_m) || slash != '/' || !pair.eof() || level.error_m < 0 ||
        level.hpl_m <= 0) {
      throw Error(
          {.what = "an error and its protection level cannot be read", .expected = "3.20/21.50", .found = cell});
    }
    levels.push_back(level);
  }
  return levels;
}

LevelFigures level_figures(int positions, const std::vector<LeveledError>& levels) {
  LevelFigures f;
  f.positions = f.below_30.of = f.usable.of = f.misleading.of = f.hazardous.of = positions;
  std::vector<double> ratios;
  for (const LeveledError& l : levels) {
    if (l.hpl_m > kAlertLimit_m) continue;
    ++f.usable.count;
    f.below_30.count += l.hpl_m <= kGoodLevel_m ? 1 : 0;
    f.misleading.count += l.error_m > l.hpl_m ? 1 : 0;
    f.hazardous.count += l.error_m > kAlertLimit_m ? 1 : 0;
    ratios.push_back(l.hpl_m / std::max(l.error_m, 1e-3));
  }
  if (ratios.empty()) return f;
  std::sort(ratios.begin(), ratios.end());
  f.least_ratio = ratios.front();
  f.ratio_95 = ratios[static_cast<std::size_t>(std::ceil(0.95 * static_cast<double>(ratios.size()))) - 1];
  return f;
}

std::string level_table_head() {
  return fmt::format(
      "| condition | positions | HPL up to {:g} m, % | up to {:g} m, % | misleading (95 %) | hazardously (95 %) | HPL "
      "/ "
      "error, 95 % quantile | least |\n|---|---|---|---|---|---|---|---|\n",
      kGoodLevel_m, kAlertLimit_m);
}

std::string level_row(std::string_view name, const LevelFigures& f) {
  const bool any = f.usable.count > 0;
  return fmt::format("| {} | {} | {} | {} | {} | {} | {} | {} |\n", name, f.positions, percent(f.below_30, false),
                     percent(f.usable, false), percent(f.misleading, true), percent(f.hazardous, true),
                     any ? fmt::format("{:.0f}", f.ratio_95) : "-", any ? fmt::format("{:.2f}", f.least_ratio) : "-");
}

std::string stanford_svg(std::string_view title, const std::vector<LeveledError>& levels) {
  std::string svg =
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 520 540' font-family='sans-serif' font-size='13'>\n"
      "<rect width='520' height='540' fill='white'/>\n" +
      text(kLeft + kSide / 2, 24, title, "middle", "font-weight='bold'") + regions();
  std::map<std::pair<int, int>, int> cells;
  for (const LeveledError& l : levels) {
    const auto cell = [](double metres) {
      return static_cast<int>(std::min(along(metres) * kDecades, kDecades - kCell / 2) / kCell);
    };
    ++cells[{cell(l.error_m), cell(l.hpl_m)}];
  }
  for (const auto& [cell, count] : cells) {
    const double side = kSide * kCell / kDecades;
    svg += fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='{:.1f}' fill='#1b4f72' fill-opacity='{:.2f}'/>\n",
                       kLeft + side * (cell.first + 0.5), kTop + kSide - side * (cell.second + 0.5), 0.55 * side,
                       std::min(1.0, 0.25 + 0.2 * std::log2(count)));
  }
  svg +=
      fmt::format("<rect x='{0}' y='{1}' width='{2}' height='{2}' fill='none' stroke='#888'/>\n", kLeft, kTop, kSide);
  svg +=
      fmt::format("<line x1='{}' y1='{}' x2='{}' y2='{}' stroke='#555'/>\n", kLeft, kTop + kSide, kLeft + kSide, kTop);
  svg += fmt::format("<line x1='{0}' y1='{1:.1f}' x2='{2}' y2='{1:.1f}' stroke='#a33' stroke-dasharray='5 4'/>\n",
                     kLeft, y_of(kAlertLimit_m), kLeft + kSide);
  for (const double metres : {1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0}) {
    svg += text(x_of(metres), kTop + kSide + 18, fmt::format("{:g}", metres), "middle");
    svg += text(kLeft - 8, y_of(metres) + 4, fmt::format("{:g}", metres), "end");
  }
  const LevelFigures f = level_figures(static_cast<int>(levels.size()), levels);
  const int unavailable = f.usable.of - f.usable.count;
  const auto label = [&](double error_m, double hpl_m, const std::string& what) {
    svg += text(x_of(error_m), y_of(hpl_m), what, "middle",
                "fill='#222' stroke='white' stroke-width='4' stroke-linejoin='round' paint-order='stroke'");
  };
  label(5, 60, fmt::format("available {}", f.usable.count - f.misleading.count));
  label(14, 1.5, fmt::format("misleading {}", f.misleading.count - f.hazardous.count));
  label(320, 8, "hazardously");
  label(320, 6, fmt::format("misleading {}", f.hazardous.count));
  label(9, 650, fmt::format("unavailable {}", unavailable));
  svg += text(kLeft + kSide / 2, kTop + kSide + 42, "error, m", "middle");
  svg += text(22, kTop + kSide / 2, "protection level, m", "middle",
              fmt::format("transform='rotate(-90 22 {})'", kTop + kSide / 2));
  return svg + "</svg>\n";
}

}  // namespace nadir::bench
