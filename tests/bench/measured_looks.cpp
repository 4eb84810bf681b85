#include "measured_looks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "estimation/map_look.hpp"

namespace nadir::bench {
namespace {

constexpr std::string_view kFormat = "# nadir measured looks, ";
constexpr std::string_view kColumns =
    "ground,window,picture,radius_m,outcome,nats,error_m,solved_m,consensus_m,height_m";
constexpr double kNear_m = 150;  // farther from the true place a chance peak may lie anywhere in the window
constexpr double kMeasuredTilt_rad = 0.1;
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

template <typename Enum, typename Names>
Enum named(const Names& names, const std::string& name, const std::string& line) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) {
    throw Error({.what = "a line of measured looks names no kind that there is", .found = line});
  }
  return static_cast<Enum>(found - names.begin());
}

MeasuredLook measured_of(const std::string& line) {
  std::istringstream in(line);
  MeasuredLook look;
  std::string window, outcome;
  char comma = 0;
  for (std::string* cell : {&look.ground, &window, &look.picture}) std::getline(in, *cell, ',');
  in >> look.radius_m >> comma;
  std::getline(in, outcome, ',');
  in >> look.log_likelihood_ratio >> comma >> look.error_m >> comma >> look.sigmas.solved_m >> comma >>
      look.sigmas.wrong_consensus_m >> comma >> look.sigmas.unmodelled_m;
  if (!in || !(in >> std::ws).eof()) throw Error({.what = "a line of measured looks cannot be read", .found = line});
  look.window = named<WindowKind>(kWindowNames, window, line);
  look.outcome = named<LookOutcome>(kOutcomeNames, outcome, line);
  return look;
}

}  // namespace

double unit_of(const std::string& ground) { return ground.starts_with("naip") ? 2.5 : 1; }

CandidateSigmas sigmas_of(const Look& look) {
  using namespace parameters::anchor_measurement;
  CandidateSigmas sigmas{look.camera_sigma_m, 0, std::sqrt(unmodelled_variance_m2(look.agl_m))};
  if (look.features.inliers < kMostPatches * look.patches) {
    sigmas.wrong_consensus_m = kWrongConsensusSigma_px * look.fine_gsd_m;
  }
  return sigmas;
}

MeasuredLook measured(const Look& look) {
  MeasuredLook row;
  row.ground = look.ground;
  row.picture = look.picture;
  row.window = look.holds_place()           ? WindowKind::holds_place
               : look.window == "elsewhere" ? WindowKind::elsewhere
                                            : WindowKind::other_map;
  const double unit = unit_of(look.ground);
  row.radius_m = nearest_radius_m(look.radius_m / unit);
  if (!look.candidate()) return row;
  row.outcome = look.right() ? LookOutcome::place : LookOutcome::chance;
  row.log_likelihood_ratio = log_likelihood_ratio(look.features);
  row.error_m = look.camera_error_m / unit;
  row.sigmas = sigmas_of(look);
  row.sigmas.solved_m /= unit, row.sigmas.wrong_consensus_m /= unit, row.sigmas.unmodelled_m /= unit;
  if (row.outcome == LookOutcome::chance && (row.window != WindowKind::holds_place || row.error_m > kNear_m)) {
    row.error_m = 0;
  }
  return row;
}

bool tilt_was_measured(const Look& look) { return look.features.tilt_sigma_rad <= kMeasuredTilt_rad; }

MeasuredLooks::MeasuredLooks(std::string origin, std::vector<MeasuredLook> looks)
    : origin_(std::move(origin)), looks_(std::move(looks)) {
  for (const MeasuredLook& look : looks_) {
    for (const double radius_m : {look.radius_m, 0.0}) {
      by_key_[key(look.ground, look.picture, look.window, radius_m)].push_back(&look);
      by_key_[key("", look.picture, look.window, radius_m)].push_back(&look);
    }
    by_key_[key("", "", look.window, 0)].push_back(&look);
  }
  for (const WindowKind window : kWindowKinds) {
    if (!by_key_.contains(key("", "", window, 0))) {
      throw Error({.what = "the measured looks have none in one kind of window",
                   .where = kWindowNames[static_cast<std::size_t>(window)],
                   .fix = "measure more: ./run bench integrity --part looks"});
    }
  }
}

MeasuredLooks MeasuredLooks::read(const std::filesystem::path& path) {
  std::istringstream in(read_text_file(path, std::uint64_t{1} << 28));
  std::string line;
  std::getline(in, line);
  if (!line.starts_with(kFormat)) {
    throw UsageError({.what = "not a file of measured looks",
                      .where = path.string(),
                      .expected = std::string(kFormat),
                      .found = line.substr(0, 80),
                      .fix = "make one: ./run bench integrity --part table"});
  }
  const std::string origin = line.substr(kFormat.size());
  std::getline(in, line);
  if (line != kColumns) {
    throw UsageError({.what = "other columns than those of measured looks",
                      .where = path.string(),
                      .expected = std::string(kColumns),
                      .found = line});
  }
  std::vector<MeasuredLook> looks;
  while (std::getline(in, line)) looks.push_back(measured_of(line));
  return {origin, std::move(looks)};
}

std::string MeasuredLooks::text() const {
  std::string text = fmt::format("{}{}\n{}\n", kFormat, origin_, kColumns);
  for (const MeasuredLook& l : looks_) {
    text += fmt::format("{},{},{},{:.0f},{},{:.2f},{:.1f},{:.1f},{:.1f},{:.1f}\n", l.ground,
                        kWindowNames[static_cast<std::size_t>(l.window)], l.picture, l.radius_m,
                        kOutcomeNames[static_cast<std::size_t>(l.outcome)], l.log_likelihood_ratio, l.error_m,
                        l.sigmas.solved_m, l.sigmas.wrong_consensus_m, l.sigmas.unmodelled_m);
  }
  return text;
}

std::vector<std::string> MeasuredLooks::grounds_with(const std::string& picture, bool registered) const {
  std::map<std::string, std::size_t> counts;
  for (const MeasuredLook& look : looks_) {
    if (look.picture != picture || look.window != WindowKind::holds_place) continue;
    if (look.ground.starts_with("pair") != registered) ++counts[look.ground];
  }
  std::vector<std::string> names;
  for (const auto& [name, count] : counts) {
    if (count >= kLeastRows) names.push_back(name);
  }
  if (names.empty()) {
    throw Error({.what = "too few measured looks of a kind of picture over any ground",
                 .where = picture,
                 .expected = fmt::format("{} in windows that hold the place", kLeastRows),
                 .fix = "measure more: ./run bench integrity --part looks"});
  }
  return names;
}

const std::vector<const MeasuredLook*>& MeasuredLooks::pool(const std::string& ground, const std::string& picture,
                                                            WindowKind window, double radius_m) const {
  for (const std::string& name : {key(ground, picture, window, radius_m), key(ground, picture, window, 0),
                                  key("", picture, window, radius_m), key("", picture, window, 0)}) {
    const auto found = by_key_.find(name);
    if (found != by_key_.end() && found->second.size() >= kLeastRows) return found->second;
  }
  return by_key_.at(key("", "", window, 0));
}

LookPools MeasuredLooks::pools(const std::string& ground, const std::string& picture) const {
  LookPools pools;
  for (std::size_t w = 0; w < kWindowKinds.size(); ++w) {
    for (std::size_t r = 0; r < LookPools::kRadii_m.size(); ++r) {
      pools.rows[w][r] = &pool(ground, picture, kWindowKinds[w], LookPools::kRadii_m[r]);
    }
  }
  return pools;
}

const MeasuredLook& LookPools::draw(WindowKind window, double radius_m, Random& random) const {
  std::size_t size = 0;
  while (kRadii_m[size] != nearest_radius_m(radius_m)) ++size;
  const auto& among = *rows[static_cast<std::size_t>(window)][size];
  return *among[static_cast<std::size_t>(random.integer(0, static_cast<int>(among.size()) - 1))];
}

}  // namespace nadir::bench
