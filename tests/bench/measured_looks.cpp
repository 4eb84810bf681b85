#include "measured_looks.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "estimation/map_look.hpp"

namespace nadir::bench {
namespace {

constexpr std::string_view kMeasuredFormat = "# nadir measured looks, ";
constexpr std::string_view kColumns =
    "count,ground,window,picture,radius_m,outcome,nats,error_m,solved_m,consensus_m,height_m,"
    "rival_nats,rival_apart_m,rival_error_m,rival_searched_m";
constexpr double kNear_m = 150;  // farther from the true place a chance peak may lie anywhere in the window
constexpr double kMeasuredTilt_rad = 0.1;
constexpr double kWeak_nats = -1;  // of chance peaks below, up to kThinned are one row
constexpr std::size_t kThinned = 8;
constexpr double kLeastRival_nats = -4;  // of rivals that are kept: less says nothing
constexpr double kClaims_nats = 0;       // what shows how much alike the looks of one picture are
constexpr std::array kWindowNames = {"holds", "elsewhere", "other"};
constexpr std::array kOutcomeNames = {"none", "place", "chance"};

double nearest_radius_m(double radius_m) {
  double best_m = LookPools::kRadii_m[0];
  for (const double r : LookPools::kRadii_m) {
    if (std::abs(std::log(r / radius_m)) < std::abs(std::log(best_m / radius_m))) best_m = r;
  }
  return best_m;
}

std::string key(const std::string& ground, const std::string& picture, WindowKind window, double radius_m) {
  return fmt::format("{}|{}|{}|{:.0f}", ground, picture, static_cast<int>(window), radius_m);
}

// Kinds are stored by their first letter.
template <typename Enum, typename Names>
Enum named(const Names& names, const std::string& letter, const std::string& line) {
  const auto found =
      std::find_if(names.begin(), names.end(), [&](const char* name) { return letter == std::string(1, name[0]); });
  if (found == names.end()) {
    throw Error({.what = "a line of measured looks names no kind that there is", .found = line});
  }
  return static_cast<Enum>(found - names.begin());
}

MeasuredLook measured_of(const std::string& line, const std::vector<std::string>& grounds,
                         const std::vector<std::string>& pictures) {
  std::istringstream in(line);
  MeasuredLook look;
  LookFinding& found = look.found;
  std::string window, outcome;
  std::size_t ground = 0, picture = 0;
  char comma = 0;
  in >> look.count >> comma >> ground >> comma;
  std::getline(in, window, ',');
  in >> picture >> comma >> look.radius_m >> comma;
  std::getline(in, outcome, ',');
  in >> found.log_likelihood_ratio >> comma >> found.error_m >> comma >> found.sigmas.solved_m >> comma >>
      found.sigmas.wrong_consensus_m >> comma >> found.sigmas.unmodelled_m >> comma >>
      found.rival.log_likelihood_ratio >> comma >> found.rival.apart_m >> comma >> found.rival.error_m >> comma >>
      found.rival.searched_m;
  if (!in || !(in >> std::ws).eof() || look.count < 1 || ground >= grounds.size() || picture >= pictures.size()) {
    throw Error({.what = "a line of measured looks cannot be read", .found = line});
  }
  look.ground = grounds[ground];
  look.picture = pictures[picture];
  look.window = named<WindowKind>(kWindowNames, window, line);
  found.outcome = named<LookOutcome>(kOutcomeNames, outcome, line);
  return look;
}

std::vector<std::string> cells_of(const std::string& line) {
  std::istringstream in(line);
  std::vector<std::string> cells;
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  return cells;
}

WindowKind kind_of(const Look& look) {
  return look.holds_place()           ? WindowKind::holds_place
         : look.window == "elsewhere" ? WindowKind::elsewhere
                                      : WindowKind::other_map;
}

// By how much the looks of one picture scatter less than as many pictures would: the variance of the number of claims
// over that of independent ones (Kish 1965).
double design_effect(const Looks& looks) {
  std::map<std::uint64_t, CountedShare> pictures;
  CountedShare all;
  for (const auto& [index, look] : looks) {
    if (look.holds_place()) continue;
    const int claims = look.candidate() && log_likelihood_ratio(look.features) > kClaims_nats ? 1 : 0;
    CountedShare& picture = pictures[picture_of(index)];
    ++picture.of, ++all.of;
    picture.count += claims, all.count += claims;
  }
  if (all.count == 0) return 1;
  double squares = 0;
  for (const auto& [number, p] : pictures) {
    const double off = p.count - all.share() * p.of;
    squares += off * off;
  }
  return std::max(1.0, squares / (all.of * all.share() * (1 - all.share())));
}

std::string group_of(const MeasuredLook& look) {
  return fmt::format("{}|{}|{}|{:.0f}", look.ground, look.picture, static_cast<int>(look.window), look.radius_m);
}

// Looks without a candidate are one row; of weak chance peaks, by their weight of evidence, the middle one of some.
std::vector<MeasuredLook> thinned(const std::vector<MeasuredLook>& looks) {
  std::vector<MeasuredLook> rows;
  std::map<std::string, std::vector<MeasuredLook>> weak;
  std::map<std::string, MeasuredLook> none;
  for (const MeasuredLook& look : looks) {
    if (look.found.outcome == LookOutcome::none) {
      const auto [row, added] = none.emplace(group_of(look), look);
      row->second.count += added ? 0 : 1;
    } else if (look.found.outcome == LookOutcome::chance && look.found.log_likelihood_ratio < kWeak_nats) {
      weak[group_of(look)].push_back(look);
    } else {
      rows.push_back(look);
    }
  }
  for (const auto& [group, row] : none) rows.push_back(row);
  for (auto& [group, members] : weak) {
    std::stable_sort(members.begin(), members.end(), [](const MeasuredLook& a, const MeasuredLook& b) {
      return a.found.log_likelihood_ratio < b.found.log_likelihood_ratio;
    });
    for (std::size_t from = 0; from < members.size(); from += kThinned) {
      const std::size_t to = std::min(from + kThinned, members.size());
      rows.push_back(members[(from + to) / 2]);
      rows.back().count = static_cast<int>(to - from);
    }
  }
  return rows;
}

}  // namespace

double unit_of(const std::string& ground) { return ground.starts_with("naip") ? 2.5 : 1; }

CandidateSigmas sigmas_of(const Look& look) {
  const double share = look.features.inliers / look.patches;
  return {look.camera_sigma_m, wrong_consensus_sigma_px(share, look.features.ratio) * look.fine_gsd_m,
          std::sqrt(unmodelled_variance_m2(look.agl_m))};
}

MeasuredLook measured(const Look& look) {
  using parameters::anchor_measurement::kRivalSigma_px;
  const double unit = unit_of(look.ground);
  MeasuredLook row{look.ground, look.picture, kind_of(look), nearest_radius_m(look.radius_m / unit), {}};
  if (!look.candidate()) return row;
  LookFinding& found = row.found;
  found.outcome = look.right() ? LookOutcome::place : LookOutcome::chance;
  found.log_likelihood_ratio = log_likelihood_ratio(look.features);
  found.error_m = look.camera_error_m / unit;
  found.sigmas = sigmas_of(look);
  found.sigmas.solved_m /= unit, found.sigmas.wrong_consensus_m /= unit, found.sigmas.unmodelled_m /= unit;
  const auto far = [&](double error_m) { return row.window != WindowKind::holds_place || error_m > kNear_m; };
  if (found.outcome == LookOutcome::chance && far(found.error_m)) found.error_m = 0;
  const double rival_nats = found.log_likelihood_ratio + rival_log_odds(look.features.ratio);
  if (look.rival_apart_m > 0 && rival_nats >= kLeastRival_nats) {
    found.rival = {rival_nats, look.rival_apart_m / unit, look.rival_error_m / unit,
                   kRivalSigma_px * look.coarse_gsd_m / unit};
    if (far(found.rival.error_m)) found.rival.error_m = 0;
  }
  return row;
}

bool tilt_was_measured(const Look& look) { return look.features.tilt_sigma_rad <= kMeasuredTilt_rad; }

void LookPool::add(const MeasuredLook& look) {
  rows.push_back(&look);
  counted.push_back(size() + look.count);
}

MeasuredLooks::MeasuredLooks(std::string origin, std::vector<MeasuredLook> looks, const Beyond& beyond)
    : origin_(std::move(origin)),
      looks_(std::move(looks)),
      tails_(std::make_unique<std::array<LookTail, kWindowKinds.size()>>()) {
  for (std::size_t i = 0; i < beyond.size(); ++i) {
    (*tails_)[i].beyond = beyond[i];
    (*tails_)[i].rate = beyond[i].upper();
  }
  for (const MeasuredLook& look : looks_) {
    for (const double radius_m : {look.radius_m, 0.0}) {
      by_key_[key(look.ground, look.picture, look.window, radius_m)].add(look);
      by_key_[key("", look.picture, look.window, radius_m)].add(look);
    }
    by_key_[key("", "", look.window, 0)].add(look);
    LookFinding& strongest = (*tails_)[static_cast<std::size_t>(look.window)].strongest;
    if (look.found.outcome == LookOutcome::chance &&
        (strongest.outcome == LookOutcome::none || look.found.log_likelihood_ratio > strongest.log_likelihood_ratio)) {
      strongest = look.found;
      strongest.error_m = strongest.rival.error_m = 0;  // anywhere in the window
    }
  }
  for (const WindowKind window : kWindowKinds) {
    if (!by_key_.contains(key("", "", window, 0))) {
      throw Error({.what = "the measured looks have none in one kind of window",
                   .where = kWindowNames[static_cast<std::size_t>(window)],
                   .fix = "measure more: ./run bench integrity --part looks"});
    }
  }
}

MeasuredLooks MeasuredLooks::reduced(std::string origin, const Looks& looks) {
  std::vector<MeasuredLook> rows;
  for (const auto& [index, look] : looks) {
    if (tilt_was_measured(look)) rows.push_back(measured(look));
  }
  MeasuredLooks table(std::move(origin), thinned(rows), {});
  const double effect = design_effect(looks);
  for (const WindowKind kind : kWindowKinds) {
    LookTail& tail = (*table.tails_)[static_cast<std::size_t>(kind)];
    for (const auto& [index, look] : looks) {
      if (!tilt_was_measured(look) || kind_of(look) != kind) continue;
      ++tail.beyond.of;
      tail.beyond.count +=
          look.candidate() && !look.right() && log_likelihood_ratio(look.features) > tail.strongest.log_likelihood_ratio
              ? 1
              : 0;
    }
    tail.beyond.of = std::max(1, static_cast<int>(tail.beyond.of / effect));
    tail.rate = tail.beyond.upper();
  }
  return table;
}

MeasuredLooks MeasuredLooks::read(const std::filesystem::path& path) {
  std::istringstream in(read_text_file(path, std::uint64_t{1} << 28));
  std::string line;
  std::getline(in, line);
  if (!line.starts_with(kMeasuredFormat)) {
    throw UsageError({.what = "not a file of measured looks",
                      .where = path.string(),
                      .expected = std::string(kMeasuredFormat),
                      .found = line.substr(0, 80),
                      .fix = "make one: ./run bench integrity --part table"});
  }
  const std::string origin = line.substr(kMeasuredFormat.size());
  std::getline(in, line);
  const std::vector<std::string> grounds = cells_of(line);
  std::getline(in, line);
  const std::vector<std::string> pictures = cells_of(line);
  std::getline(in, line);
  std::istringstream counts(line);
  Beyond beyond;
  for (CountedShare& share : beyond) counts >> share.count >> share.of;
  std::getline(in, line);
  if (!counts || line != kColumns) {
    throw UsageError({.what = "other columns than those of measured looks",
                      .where = path.string(),
                      .expected = std::string(kColumns),
                      .found = line});
  }
  std::vector<MeasuredLook> looks;
  while (std::getline(in, line)) looks.push_back(measured_of(line, grounds, pictures));
  return {origin, std::move(looks), beyond};
}

std::string MeasuredLooks::text() const {
  std::vector<std::string> grounds, pictures;
  for (const MeasuredLook& look : looks_) grounds.push_back(look.ground), pictures.push_back(look.picture);
  for (auto* names : {&grounds, &pictures}) {
    std::sort(names->begin(), names->end());
    names->erase(std::unique(names->begin(), names->end()), names->end());
  }
  const auto number = [](const std::vector<std::string>& names, const std::string& name) {
    return std::find(names.begin(), names.end(), name) - names.begin();
  };
  std::string beyond;
  for (const LookTail& tail : *tails_) {
    beyond += fmt::format("{}{} {}", beyond.empty() ? "" : " ", tail.beyond.count, tail.beyond.of);
  }
  std::string text = fmt::format("{}{}\n{}\n{}\n{}\n{}\n", kMeasuredFormat, origin_, fmt::join(grounds, ","),
                                 fmt::join(pictures, ","), beyond, kColumns);
  for (const MeasuredLook& l : looks_) {
    const LookFinding& f = l.found;
    const std::string rival = f.has_rival() ? fmt::format("{:.3g},{:.3g},{:.3g},{:.2g}", f.rival.log_likelihood_ratio,
                                                          f.rival.apart_m, f.rival.error_m, f.rival.searched_m)
                                            : "0,0,0,0";
    text +=
        fmt::format("{},{},{},{},{:.0f},{},{:.3g},{:.3g},{:.2g},{:.2g},{:.2g},{}\n", l.count, number(grounds, l.ground),
                    kWindowNames[static_cast<std::size_t>(l.window)][0], number(pictures, l.picture), l.radius_m,
                    kOutcomeNames[static_cast<std::size_t>(f.outcome)][0], f.log_likelihood_ratio, f.error_m,
                    f.sigmas.solved_m, f.sigmas.wrong_consensus_m, f.sigmas.unmodelled_m, rival);
  }
  return text;
}

std::string MeasuredLooks::summary() const {
  std::string table =
      "| window | looks | rows | strongest chance peak, nats | stronger, of an effective number | at most |\n"
      "|---|---|---|---|---|---|\n";
  for (const WindowKind kind : kWindowKinds) {
    const LookPool& all = by_key_.at(key("", "", kind, 0));
    const LookTail& tail = (*tails_)[static_cast<std::size_t>(kind)];
    table += fmt::format("| {} | {} | {} | {:.2f} | {} of {} | {:.1e} |\n",
                         kWindowNames[static_cast<std::size_t>(kind)], all.size(), all.rows.size(),
                         tail.strongest.log_likelihood_ratio, tail.beyond.count, tail.beyond.of, tail.rate);
  }
  return table;
}

std::vector<std::string> MeasuredLooks::grounds_with(const std::string& picture, bool registered) const {
  std::map<std::string, int> counts;
  for (const MeasuredLook& look : looks_) {
    if (look.picture != picture || look.window != WindowKind::holds_place) continue;
    if (look.ground.starts_with("pair") != registered) counts[look.ground] += look.count;
  }
  std::vector<std::string> names;
  for (const auto& [name, count] : counts) {
    if (count >= kLeastLooks) names.push_back(name);
  }
  if (names.empty()) {
    throw Error({.what = "too few measured looks of a kind of picture over any ground",
                 .where = picture,
                 .expected = fmt::format("{} in windows that hold the place", kLeastLooks),
                 .fix = "measure more: ./run bench integrity --part looks"});
  }
  return names;
}

const LookPool& MeasuredLooks::pool(const std::string& ground, const std::string& picture, WindowKind window,
                                    double radius_m) const {
  for (const std::string& name : {key(ground, picture, window, radius_m), key(ground, picture, window, 0),
                                  key("", picture, window, radius_m), key("", picture, window, 0)}) {
    const auto found = by_key_.find(name);
    if (found != by_key_.end() && found->second.size() >= kLeastLooks) return found->second;
  }
  return by_key_.at(key("", "", window, 0));
}

LookPools MeasuredLooks::pools(const std::string& ground, const std::string& picture) const {
  LookPools pools;
  pools.tails = tails_.get();
  for (std::size_t w = 0; w < kWindowKinds.size(); ++w) {
    for (std::size_t r = 0; r < LookPools::kRadii_m.size(); ++r) {
      pools.pools[w][r] = &pool(ground, picture, kWindowKinds[w], LookPools::kRadii_m[r]);
    }
  }
  return pools;
}

LookFinding LookPools::draw(WindowKind window, double radius_m, Random& random) const {
  const LookTail& tail = (*tails)[static_cast<std::size_t>(window)];
  if (random.chance(tail.rate)) {
    LookFinding found = tail.strongest;
    found.outcome = LookOutcome::chance;
    found.log_likelihood_ratio -= std::log(1 - random.uniform());
    return found;
  }
  std::size_t size = 0;
  while (kRadii_m[size] != nearest_radius_m(radius_m)) ++size;
  const LookPool& among = *pools[static_cast<std::size_t>(window)][size];
  const int number = random.integer(0, among.size() - 1);
  const auto at = std::upper_bound(among.counted.begin(), among.counted.end(), number) - among.counted.begin();
  return among.rows[static_cast<std::size_t>(at)]->found;
}

}  // namespace nadir::bench
