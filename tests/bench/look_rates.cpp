#include "look_rates.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "estimation/map_look.hpp"
#include "measured_looks.hpp"

namespace nadir::bench {
namespace {

double weight(const Look& look) { return log_likelihood_ratio(look.features); }
bool true_place(const Look& look) { return look.right(); }

std::string percent(const CountedShare& share) {
  return share.of == 0 ? "-" : fmt::format("{:.3g}", 100 * share.share());
}

std::vector<std::string> families(const Looks& looks) {
  std::set<std::string> names;
  for (const auto& [index, look] : looks) names.insert(family(look));
  return {names.begin(), names.end()};
}

LookFilter both(const LookFilter& a, const LookFilter& b) {
  return [a, b](const Look& look) { return a(look) && b(look); };
}
LookFilter of_family(const std::string& name) {
  return [name](const Look& look) { return family(look) == name; };
}

std::string chance_table(const Looks& looks) {
  std::string text = "| looks without their place | number | candidates |";
  for (const double t : kThresholds) text += fmt::format(" above {:g}, % (95 %) |", t);
  text += "\n|---|---|---|" + std::string("---|---|---|---|---|") + "\n";
  const auto row = [&](const std::string& name, const LookFilter& filter) {
    int all = 0, candidates = 0;
    for (const auto& [index, look] : looks) {
      if (filter(look)) ++all, candidates += look.candidate() ? 1 : 0;
    }
    if (all == 0) return;
    text += fmt::format("| {} | {} | {} |", name, all, candidates);
    for (const double t : kThresholds) {
      const CountedShare share = share_above(looks, t, filter);
      text += fmt::format(" {} ({}: {:.2g} to {:.2g}) |", percent(share), share.count, 100 * share.lower(),
                          100 * share.upper());
    }
    text += "\n";
  };
  row("**all**", knocked_out);
  for (const std::string& name : families(looks)) row(name, both(knocked_out, of_family(name)));
  for (const char* window : {"elsewhere", "mirrored", "turned", "other"}) {
    row(window, both(knocked_out, [window](const Look& look) { return look.window == window; }));
  }
  row("another place in a window that holds it", [](const Look& look) { return look.holds_place() && !look.right(); });
  return text;
}

std::string availability_table(const Looks& looks) {
  std::string text = "| looks that hold their place | number | candidate is the place, % |";
  for (const double t : kThresholds) text += fmt::format(" and above {:g}, % |", t);
  text += " above 1000, % |\n|---|---|---|---|---|---|---|---|---|\n";
  const auto row = [&](const std::string& name, const LookFilter& filter) {
    int all = 0, right = 0, accepted = 0;
    for (const auto& [index, look] : looks) {
      if (!look.holds_place() || !filter(look)) continue;
      ++all, right += look.right() ? 1 : 0, accepted += look.right() && look.accepted() ? 1 : 0;
    }
    if (all == 0) return;
    text += fmt::format("| {} | {} | {:.1f} |", name, all, 100.0 * right / all);
    for (const double t : kThresholds) {
      text += fmt::format(" {:.1f} |", 100.0 * share_above(looks, t, both(true_place, filter)).count / all);
    }
    text += fmt::format(" {:.1f} |\n", 100.0 * accepted / all);
  };
  row("**all**", [](const Look&) { return true; });
  for (const std::string& name : families(looks)) row(name, of_family(name));
  for (const char* picture : {"clear", "old", "clouds", "blur", "night"}) {
    row(picture, [picture](const Look& look) { return look.picture == picture; });
  }
  return text;
}

// The looks whose weight of evidence lies in a band: how much evidence that really is.
struct Band {
  double stated = 0;  // mean
  CountedShare right, chance;
  double observed() const { return std::log(right.share() / chance.share()); }
};

std::vector<Band> bands(const Looks& looks) {
  constexpr double kWidth = 1;
  std::map<int, std::vector<const Look*>> by_band;
  int rights = 0, chances = 0;
  for (const auto& [index, look] : looks) {
    if (!look.candidate()) continue;
    ++(look.right() ? rights : chances);
    by_band[static_cast<int>(std::floor(weight(look) / kWidth))].push_back(&look);
  }
  std::vector<Band> all;
  for (const auto& [number, members] : by_band) {
    Band band{0, {0, rights}, {0, chances}};
    for (const Look* look : members) {
      band.stated += weight(*look) / static_cast<double>(members.size());
      ++(look->right() ? band.right : band.chance).count;
    }
    all.push_back(band);
  }
  return all;
}

std::string reliability_table(const Looks& looks) {
  std::string text =
      "| stated weight of evidence, nats | true places | chance peaks | observed, nats (95 %) |\n|---|---|---|---|\n";
  for (const Band& band : bands(looks)) {
    const double low = std::log(band.right.lower() / band.chance.upper());
    const double high = std::log(band.right.upper() / band.chance.lower());
    const auto number = [](double nats) { return std::isfinite(nats) ? fmt::format("{:.1f}", nats) : "∞"; };
    text += fmt::format("| {:.1f} | {} | {} | {} ({} to {}) |\n", band.stated, band.right.count, band.chance.count,
                        band.right.count == 0 ? "-∞" : number(band.observed()),
                        band.right.count == 0 ? "-∞" : number(low), number(high));
  }
  return text;
}

// Whether candidates claim too much where another place scores nearly as well, and how often that place, the rival, is
// the true one: in windows that hold it, over grounds whose registration is known. With n+ right and n- wrong ones of
// all candidates there, 1 / (1 + Λ n+ / n-) of each is expected to be wrong; and with the odds of rival_log_odds(), of
// those where one of the two is right, so many rivals to be right.
std::string rival_table(const Looks& looks) {
  static constexpr std::array kRatios = {0.5, 0.7, 0.8, 0.85, 0.9, 0.95, 1.0};
  constexpr double kLeast = 3;
  struct Row {
    int right = 0, wrong = 0, rival = 0;
    double wrong_expected = 0, rival_expected = 0;
  };
  std::array<Row, kRatios.size()> rows;
  const auto counts = [](const Look& look) {
    return look.window == "right" && look.candidate() && family(look) != "pair" && tilt_was_measured(look);
  };
  double all_right = 0, all_wrong = 0;
  for (const auto& [index, look] : looks) {
    if (counts(look)) ++(look.right() ? all_right : all_wrong);
  }
  for (const auto& [index, look] : looks) {
    if (!counts(look) || weight(look) <= std::log(kLeast)) continue;
    const auto at = std::upper_bound(kRatios.begin(), kRatios.end() - 1, look.features.ratio) - kRatios.begin();
    Row& row = rows[static_cast<std::size_t>(at)];
    const bool rival = !look.right() && look.rival_apart_m > 0 && look.rival_error_m <= look.tolerance_m;
    ++(look.right() ? row.right : row.wrong);
    row.wrong_expected += 1 / (1 + std::exp(weight(look)) * all_right / all_wrong);
    if (!look.right() && !rival) continue;
    row.rival += rival ? 1 : 0;
    row.rival_expected += 1 / (1 + std::exp(-rival_log_odds(look.features.ratio)));
  }
  std::string text = fmt::format(
      "| best score elsewhere over the candidate's | right, with Λ above {:g} | wrong | expected | rival right | "
      "expected |\n|---|---|---|---|---|---|\n",
      kLeast);
  double from = 0;
  for (std::size_t i = 0; i < rows.size(); from = kRatios[i++]) {
    const Row& row = rows[i];
    text += fmt::format("| {:g} to {:.2g} | {} | {} | {:.1f} | {} | {:.1f} |\n", from, kRatios[i], row.right, row.wrong,
                        row.wrong_expected, row.rival, row.rival_expected);
  }
  return text;
}

// ---- Drawing

struct Panel {
  double left, top, width, height, x_low, x_high, y_low, y_high;
  double x(double value) const { return left + width * (std::clamp(value, x_low, x_high) - x_low) / (x_high - x_low); }
  double y(double value) const { return top + height * (y_high - std::clamp(value, y_low, y_high)) / (y_high - y_low); }
};

std::string text_at(double x, double y, const std::string& text, const char* anchor, const std::string& more = "") {
  return fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='{}' {}>{}</text>\n", x, y, anchor, more, text);
}

std::string frame_of(const Panel& p, const std::string& below, const std::string& beside) {
  return fmt::format("<rect x='{}' y='{}' width='{}' height='{}' fill='none' stroke='#888'/>\n", p.left, p.top, p.width,
                     p.height) +
         text_at(p.left + p.width / 2, p.top + p.height + 40, below, "middle") +
         text_at(p.left - 64, p.top + p.height / 2, beside, "middle",
                 fmt::format("transform='rotate(-90 {} {})'", p.left - 64, p.top + p.height / 2));
}

std::string reliability_panel(const Looks& looks) {
  const double limit = look_likelihood_table().limit;
  const double reach = std::ceil(limit);
  const Panel p{80, 30, 360, 360, -reach, reach, -reach, reach};
  std::string svg = frame_of(p, "stated weight of evidence, nats", "observed, nats");
  for (double tick = -reach + std::fmod(reach, 2); tick <= reach; tick += 2) {
    svg += text_at(p.x(tick), p.top + p.height + 18, fmt::format("{:g}", tick), "middle");
    svg += text_at(p.left - 8, p.y(tick) + 4, fmt::format("{:g}", tick), "end");
  }
  svg += fmt::format("<line x1='{:.1f}' y1='{:.1f}' x2='{:.1f}' y2='{:.1f}' stroke='#bbb' stroke-dasharray='4 4'/>\n",
                     p.x(-reach), p.y(-reach), p.x(reach), p.y(reach));
  for (const Band& band : bands(looks)) {
    const double low = std::log(std::max(1e-9, band.right.lower()) / band.chance.upper());
    const double high = std::log(band.right.upper() / std::max(1e-9, band.chance.lower()));
    svg += fmt::format("<line x1='{0:.1f}' y1='{1:.1f}' x2='{0:.1f}' y2='{2:.1f}' stroke='#1b6ca8'/>\n",
                       p.x(band.stated), p.y(low), p.y(high));
    if (band.right.count == 0 || band.chance.count == 0) continue;
    svg +=
        fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='4' fill='#1b6ca8'/>\n", p.x(band.stated), p.y(band.observed()));
  }
  return svg;
}

std::string exceedance_panel(const Looks& looks) {
  static constexpr std::array kColours = {"#1b6ca8", "#c0562f", "#4b8b3b", "#7a4b9e", "#b8860b", "#2a9d8f", "#d1495b"};
  const Panel p{550, 30, 350, 360, 0, 4, -5, 0};  // powers of ten
  std::string svg = frame_of(p, "likelihood ratio t", "share of looks without their place above t");
  for (int power = 0; power <= 4; ++power) {
    svg += text_at(p.x(power), p.top + p.height + 18, fmt::format("{:g}", std::pow(10, power)), "middle");
  }
  for (int power = -5; power <= 0; ++power) {
    svg += text_at(p.left - 8, p.y(power) + 4, fmt::format("{:g} %", 100 * std::pow(10, power)), "end");
  }
  svg += fmt::format("<line x1='{:.1f}' y1='{:.1f}' x2='{:.1f}' y2='{:.1f}' stroke='#bbb' stroke-dasharray='4 4'/>\n",
                     p.x(0), p.y(0), p.x(4), p.y(-4));
  svg += text_at(p.x(2.1), p.y(-1.95), "1 / t", "start", "fill='#888'");
  std::vector<std::string> names = families(looks);
  names.insert(names.begin(), "all");
  double row = p.top + 18;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const LookFilter filter = i == 0 ? LookFilter(knocked_out) : both(knocked_out, of_family(names[i]));
    const std::string colour = i == 0 ? "black" : kColours[(i - 1) % kColours.size()];
    std::string points;
    for (double power = 0; power <= 4; power += 0.1) {
      const CountedShare share = share_above(looks, std::pow(10, power), filter);
      if (share.count == 0) break;
      points += fmt::format("{:.1f},{:.1f} ", p.x(power), p.y(std::log10(share.share())));
    }
    const int of = share_above(looks, 1, filter).of;
    if (of == 0) continue;
    svg += fmt::format("<polyline fill='none' stroke='{}' stroke-width='{}' points='{}'/>\n", colour, i == 0 ? 3 : 1.5,
                       points);
    svg += text_at(p.left + p.width - 8, row, fmt::format("{} ({})", names[i], of), "end",
                   fmt::format("fill='{}'", colour));
    row += 17;
  }
  return svg;
}

}  // namespace

bool knocked_out(const Look& look) { return !look.holds_place(); }

std::string family(const Look& look) {
  const std::string first = look.ground.substr(0, look.ground.find(' '));
  return look.ground.find("flight") == std::string::npos ? first : first + " flight";
}

CountedShare share_above(const Looks& looks, double ratio, const LookFilter& filter) {
  CountedShare share;
  const double least = std::log(ratio);
  for (const auto& [index, look] : looks) {
    if (!filter(look)) continue;
    ++share.of;
    share.count += look.candidate() && weight(look) > least ? 1 : 0;
  }
  return share;
}

CountedShare pictures_above(const Looks& looks, double ratio) {
  std::map<std::uint64_t, bool> pictures;
  for (const auto& [index, look] : looks) {
    if (knocked_out(look)) pictures[picture_of(index)] |= look.candidate() && weight(look) > std::log(ratio);
  }
  CountedShare share{0, static_cast<int>(pictures.size())};
  for (const auto& [picture, above] : pictures) share.count += above ? 1 : 0;
  return share;
}

std::string picture_table(const Looks& looks) {
  std::string head = "| pictures with looks without their place |", rule = "|---|", row;
  for (const double t : kThresholds) {
    const CountedShare share = pictures_above(looks, t);
    head += fmt::format(" one above {:g}, % (95 %) |", t);
    rule += "---|";
    row += fmt::format(" {} ({}: {:.2g} to {:.2g}) |", percent(share), share.count, 100 * share.lower(),
                       100 * share.upper());
  }
  return fmt::format("{}\n{}\n| {} |{}\n", head, rule, pictures_above(looks, 1).of, row);
}

std::string contradictions(const Looks& looks) {
  std::string text;
  for (const double t : kThresholds) {
    const CountedShare share = share_above(looks, t, knocked_out);
    if (share.lower() > 1 / t) {
      text += fmt::format(
          "{} of {} looks without their place have a likelihood ratio above {:g}: {:.3g} % at least, and {:.3g} % "
          "are allowed\n",
          share.count, share.of, t, 100 * share.lower(), 100 / t);
    }
  }
  return text;
}

std::string rate_tables(const Looks& looks) {
  return chance_table(looks) + "\n" + availability_table(looks) + "\n" + reliability_table(looks) + "\n" +
         rival_table(looks);
}

std::string reliability_svg(const Looks& looks) {
  return "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 920 460' font-family='sans-serif' font-size='13'>\n"
         "<rect width='920' height='460' fill='white'/>\n" +
         reliability_panel(looks) + exceedance_panel(looks) + "</svg>\n";
}

}  // namespace nadir::bench
