#include "roc_table.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace nadir::bench {
namespace {

std::string row(const std::string& name, const Shares& shares) {
  return fmt::format("| {} | {:.1f} | {:.2f} | {} |\n", name, 100 * shares.right, 100 * shares.wrong,
                     shares.wrong_count);
}

// How good wrong matches are in one measure for a given value of another: what a likelihood must exclude.
std::string reach_of_wrong(const Looks& looks) {
  std::string text =
      "| wrong places with a ratio of | number | highest score | highest share of agreeing patches | highest patches | "
      "score >= 0.16 and share >= 20 % |\n|---|---|---|---|---|---|\n";
  for (const auto& [low, high] : {std::pair{0.0, 0.55}, {0.55, 0.7}, {0.7, 0.8}, {0.8, 0.9}, {0.9, 1.01}}) {
    int count = 0, both = 0, patches = 0;
    double score = 0, share = 0;
    for (const auto& [index, t] : looks) {
      if (t.holds_place() || t.features.ratio < low || t.features.ratio >= high) continue;
      ++count;
      score = std::max(score, t.features.score), share = std::max(share, t.features.inlier_share);
      patches = std::max(patches, static_cast<int>(t.features.inliers));
      if (t.features.score >= 0.16 && t.features.inlier_share >= 0.2) ++both;
    }
    text += fmt::format("| {:.2f} to {:.2f} | {} | {:.2f} | {:.0f} % | {} | {} |\n", low, std::min(high, 1.0), count,
                        score, 100 * share, patches, both);
  }
  return text;
}

// Patches that agree by chance scatter evenly within the tolerance; those of the correct place do not.
std::string reach_by_share(const Looks& looks) {
  std::string text =
      "| share of agreeing patches | right places | their median and largest residual, px | wrong places | their "
      "smallest and median residual, px |\n|---|---|---|---|---|\n";
  for (const auto& [low, high] : {std::pair{0.10, 0.15}, {0.15, 0.2}, {0.2, 0.25}, {0.25, 0.35}, {0.35, 1.01}}) {
    std::vector<double> right, wrong;
    for (const auto& [index, t] : looks) {
      if (!t.candidate() || t.features.inlier_share < low || t.features.inlier_share >= high) continue;
      if (t.holds_place() == t.right()) (t.right() ? right : wrong).push_back(t.features.residual_px);
    }
    std::sort(right.begin(), right.end()), std::sort(wrong.begin(), wrong.end());
    const auto median = [](const std::vector<double>& sorted) { return sorted[sorted.size() / 2]; };
    text += fmt::format("| {:.0f} to {:.0f} % | {} | {} | {} | {} |\n", 100 * low, 100 * std::min(high, 1.0),
                        right.size(), right.empty() ? "" : fmt::format("{:.2f}, {:.2f}", median(right), right.back()),
                        wrong.size(), wrong.empty() ? "" : fmt::format("{:.2f}, {:.2f}", wrong.front(), median(wrong)));
  }
  return text;
}

std::string verdicts(const Looks& looks) {
  std::map<std::string, std::map<std::string, int>> counts;  // by window, then verdict
  for (const auto& [index, t] : looks) ++counts[t.window + (t.holds_place() ? ", " + t.picture : "")][t.verdict];
  std::string text = "| window | verdicts |\n|---|---|\n";
  for (const auto& [window, of] : counts) {
    std::string list;
    for (const auto& [verdict, count] : of) list += fmt::format("{}{} {}", list.empty() ? "" : ", ", count, verdict);
    text += fmt::format("| {} | {} |\n", window, list);
  }
  return text;
}

}  // namespace

const std::vector<Measure>& measures() {
  static const std::vector<Measure> all = {
      {"ratio", [](const Look& t) { return -t.features.ratio; }, {.4, .5, .55, .6, .65, .7, .75, .8, .85, .9, .95}, -1},
      {"score", [](const Look& t) { return t.features.score; }, {.10, .12, .14, .16, .18, .20, .22, .25, .30}},
      {"residual", [](const Look& t) { return -t.features.residual_px; }, {1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.5}, -1},
      {"likelihood ratio",
       [](const Look& t) { return t.candidate() ? log_likelihood_ratio(t.features) : -1e3; },
       {0, 1, 2, 3, 4, 5, 6, 7, 8}},
      {"agreeing share", [](const Look& t) { return t.features.inlier_share; }, {.05, .1, .15, .2, .25, .3, .4, .5}},
  };
  return all;
}

Shares shares_if(const Looks& looks, const std::function<bool(const Look&)>& accepts) {
  Shares shares;
  int holding = 0, not_holding = 0;
  for (const auto& [index, t] : looks) {
    ++(t.holds_place() ? holding : not_holding);
    if (!t.candidate() || !accepts(t)) continue;
    ++(t.right() ? shares.right_count : shares.wrong_count);
  }
  shares.right = holding == 0 ? 0 : static_cast<double>(shares.right_count) / holding;
  shares.wrong = not_holding == 0 ? 0 : static_cast<double>(shares.wrong_count) / not_holding;
  return shares;
}

std::string tables(const Looks& looks) {
  std::string text = "| accepted if | right % | wrong % | wrong |\n|---|---|---|---|\n";
  for (const Measure& measure : measures()) {
    for (const double threshold : measure.thresholds) {
      const auto accepts = [&](const Look& t) { return measure.value(t) >= measure.sign * threshold; };
      text += row(fmt::format("{} {} {:.2f}", measure.name, measure.sign < 0 ? "<=" : ">=", threshold),
                  shares_if(looks, accepts));
    }
  }
  const Shares sure = shares_if(looks, [](const Look& t) { return t.accepted(); });
  text += row("**likelihood ratio 1000 and more**", sure);
  const auto knocked_out =
      std::count_if(looks.begin(), looks.end(), [](const auto& entry) { return !entry.second.holds_place(); });
  text += fmt::format("\n{} windows hold the place, {} do not; a likelihood ratio of 1000 accepts {} wrong places",
                      looks.size() - static_cast<std::size_t>(knocked_out), knocked_out, sure.wrong_count);
  // With none among n, the rate lies below 3/n with 95 % confidence.
  if (sure.wrong_count == 0 && knocked_out > 0) {
    text += fmt::format(" (95 % confidence: fewer than {:.2f} % are)", 300.0 / static_cast<double>(knocked_out));
  }
  text += "\n\n" + reach_of_wrong(looks) + "\n" + reach_by_share(looks) + "\n" + verdicts(looks);
  for (const auto& [index, t] : looks) {
    if (t.accepted() && !t.right()) text += "WRONG " + line(t);
  }
  return text;
}

}  // namespace nadir::bench
