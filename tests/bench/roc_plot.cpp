#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "roc_table.hpp"

namespace nadir::bench {
namespace {

constexpr double kLeft = 70, kTop = 30, kWidth = 520, kHeight = 360;
constexpr std::array kColours = {"#1b6ca8", "#c0562f", "#4b8b3b", "#111111", "#7a4b9e"};

// Logarithmic in the wrong ones; all below `least` lies on the left edge.
double x_of(double wrong, double least) {
  return kLeft + kWidth * (1 - std::log(std::max(wrong, least)) / std::log(least));
}
double y_of(double right) { return kTop + kHeight * (1 - right); }

std::string curve(const Looks& looks, const Measure& measure, double least) {
  std::vector<double> values;
  for (const auto& [index, t] : looks) values.push_back(measure.value(t));
  std::sort(values.rbegin(), values.rend());
  values.erase(std::unique(values.begin(), values.end()), values.end());
  std::string points;
  const std::size_t stride = std::max<std::size_t>(1, values.size() / 400);
  for (std::size_t i = 0; i < values.size(); i += stride) {
    const Shares shares = shares_if(looks, [&](const Look& t) { return measure.value(t) >= values[i]; });
    points += fmt::format("{:.1f},{:.1f} ", x_of(shares.wrong, least), y_of(shares.right));
  }
  return points;
}

std::string text(double x, double y, const std::string& what, const char* anchor, const char* more = "") {
  return fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='{}' {}>{}</text>\n", x, y, anchor, more, what);
}

std::string axes(double least) {
  std::string svg = fmt::format("<rect x='{}' y='{}' width='{}' height='{}' fill='none' stroke='#888'/>\n", kLeft, kTop,
                                kWidth, kHeight);
  for (int percent = 0; percent <= 100; percent += 20) {
    svg += text(kLeft - 8, y_of(percent / 100.0) + 4, fmt::format("{} %", percent), "end");
  }
  for (double share = 1; share > least * 2; share /= 10) {  // no room for labels closer to "none"
    svg += text(x_of(share, least), kTop + kHeight + 18, fmt::format("{:g} %", 100 * share), "middle");
  }
  svg += text(kLeft, kTop + kHeight + 18, "none", "middle");
  svg += text(kLeft + kWidth / 2, kTop + kHeight + 42, "wrong places accepted, of windows that do not hold the place",
              "middle");
  return svg + text(18, kTop + kHeight / 2, "right places accepted", "middle",
                    fmt::format("transform='rotate(-90 18 {})'", kTop + kHeight / 2).c_str());
}

}  // namespace

std::string roc_svg(const Looks& looks) {
  const auto knocked_out = static_cast<double>(
      std::count_if(looks.begin(), looks.end(), [](const auto& entry) { return !entry.second.holds_place(); }));
  const double least = 0.5 / std::max(1.0, knocked_out);
  std::string svg =
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 640 460' font-family='sans-serif' font-size='13'>\n"
      "<rect width='640' height='460' fill='white'/>\n" +
      axes(least);
  for (std::size_t i = 0; i < measures().size(); ++i) {
    svg += fmt::format("<polyline fill='none' stroke='{}' stroke-width='2' points='{}'/>\n", kColours[i],
                       curve(looks, measures()[i], least));
    svg += text(kLeft + kWidth - 12, kTop + kHeight - 106 + 18 * static_cast<double>(i), measures()[i].name + " alone",
                "end", fmt::format("fill='{}'", kColours[i]).c_str());
  }
  const Shares sure = shares_if(looks, [](const Look& t) { return t.accepted(); });
  svg +=
      fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='6' fill='black'/>\n", x_of(sure.wrong, least), y_of(sure.right));
  svg += text(kLeft + kWidth - 12, kTop + kHeight - 16, "likelihood ratio 1000 (dot)", "end");
  return svg + "</svg>\n";
}

}  // namespace nadir::bench
