#include "repeated_looks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "measured_looks.hpp"

namespace nadir::bench {
namespace {

constexpr std::string_view kFormat = "# nadir bench repeated looks, ", kStored = "# nadir repeated looks, ";
constexpr double kDisc = parameters::belief::kChi2_95, kRing = parameters::belief::kChi2_999;

RepeatedLook::One one_of(const Look& look) {
  RepeatedLook::One one;
  one.candidate = look.candidate();
  if (!one.candidate) return one;
  one.right = look.right();
  one.log_likelihood_ratio = log_likelihood_ratio(look.features);
  one.off_m = look.off_m;
  one.sigma_m = std::sqrt(sigmas_of(look).variance_m2());
  return one;
}

std::string text(const RepeatedLook::One& one) {
  return fmt::format("{:d},{:d},{:.3f},{:.1f},{:.1f},{:.1f}", one.candidate, one.right, one.log_likelihood_ratio,
                     one.off_m.x(), one.off_m.y(), one.sigma_m);
}

}  // namespace

std::string repeated_header(std::uint64_t base_seed, const LookPlan& plan, const Grounds& grounds) {
  return fmt::format(
      "{}base seed {}, {:g} real, {:g} right, grounds: {}\n"
      "index,ground,window,picture,new_ground,candidate,right,nats,east_m,north_m,sigma_m,"
      "candidate,right,nats,east_m,north_m,sigma_m\n",
      kFormat, base_seed, plan.real_share, plan.right_share, grounds.names());
}

std::string line(const RepeatedLook& look) {
  return fmt::format("{},{},{},{},{:.3f},{},{}\n", look.index, look.ground, look.window, look.picture, look.new_ground,
                     text(look.first), text(look.second));
}

RepeatedLook repeated_look_of(const std::string& text) {
  std::istringstream in(text);
  RepeatedLook look;
  char comma = 0;
  in >> look.index >> comma;
  for (std::string* cell : {&look.ground, &look.window, &look.picture}) std::getline(in, *cell, ',');
  in >> look.new_ground;
  for (RepeatedLook::One* one : {&look.first, &look.second}) {
    in >> comma >> one->candidate >> comma >> one->right >> comma >> one->log_likelihood_ratio >> comma >>
        one->off_m.x() >> comma >> one->off_m.y() >> comma >> one->sigma_m;
  }
  if (!in || !(in >> std::ws).eof()) throw Error({.what = "a line of results cannot be read", .found = text});
  return look;
}

RepeatedLook take_repeated_look(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed,
                                std::uint64_t index) {
  const LooksInARow row = take_looks_in_a_row(grounds, plan, base_seed, index);
  return {index,          row.first.ground,  row.first.window,  row.first.picture,
          row.new_ground, one_of(row.first), one_of(row.second)};
}

std::size_t RepeatRates::bin_of(double new_ground) {
  std::size_t best = 0;
  for (std::size_t i = 1; i < kNewGround.size(); ++i) {
    if (std::abs(new_ground - kNewGround[i]) < std::abs(new_ground - kNewGround[best])) best = i;
  }
  return best;
}

RepeatRates::RepeatRates(std::string origin, const RepeatedLooks& looks) : origin_(std::move(origin)) {
  for (const auto& [index, look] : looks) {
    Bin& bin = bins_[bin_of(look.new_ground)];
    const Eigen::Vector2d moved_m = look.second.off_m - look.first.off_m;
    if (look.first.chance()) {
      ++bin.chance;
      if (!look.second.chance()) continue;
      const double d2 =
          moved_m.squaredNorm() / (look.first.sigma_m * look.first.sigma_m + look.second.sigma_m * look.second.sigma_m);
      bin.ring += d2 > kDisc && d2 <= kRing ? 1 : 0;
      if (d2 > kDisc) continue;
      ++bin.disc;
      pairs_.push_back(
          {look.first.log_likelihood_ratio, look.second.log_likelihood_ratio, moved_m.norm() / unit_of(look.ground)});
    } else if (look.first.right && look.second.right) {
      ++bin.same_side.of;
      bin.same_side.count += look.first.off_m.dot(look.second.off_m) > 0 ? 1 : 0;
    }
  }
  finish();
}

void RepeatRates::finish() {
  for (std::size_t i = 0; i < bins_.size(); ++i) {
    const Bin& bin = bins_[i];
    const double by_accident = kDisc / (kRing - kDisc) * CountedShare{bin.ring, bin.chance}.lower();
    again_[i] = std::clamp(CountedShare{bin.disc, bin.chance}.upper() - by_accident, 0.0, 1.0);
    stays_[i] = std::max(0.0, 2 * bin.same_side.upper() - 1);
  }
  if (pairs_.size() < 2) {
    throw Error({.what = "no chance peaks were seen twice: nothing to draw from",
                 .fix = "measure more: ./run bench integrity --part repeats"});
  }
  Again mean;
  const auto count = static_cast<double>(pairs_.size());
  for (const Again& p : pairs_) mean.first += p.first / count, mean.second += p.second / count;
  double squares = 0, products = 0;
  for (const Again& p : pairs_) {
    squares += (p.first - mean.first) * (p.first - mean.first);
    products += (p.first - mean.first) * (p.second - mean.second);
  }
  slope_ = squares > 0 ? products / squares : 0;
  intercept_ = mean.second - slope_ * mean.first;
}

RepeatRates::Draw RepeatRates::draw(double first_log_likelihood_ratio, Random& random) const {
  const Again& p = pairs_[static_cast<std::size_t>(random.integer(0, static_cast<int>(pairs_.size()) - 1))];
  return {p.second + slope_ * (first_log_likelihood_ratio - p.first), p.moved_m};
}

bool is_repeated_looks(const std::filesystem::path& path) {
  return read_text_file(path, std::uint64_t{1} << 30).starts_with(kFormat);
}

RepeatRates RepeatRates::reduced(const std::filesystem::path& path) {
  std::istringstream in(read_text_file(path, std::uint64_t{1} << 30));
  std::string text;
  std::getline(in, text);
  const std::string run = text.substr(std::min(text.size(), kFormat.size()), text.find(", grounds: ") - kFormat.size());
  std::getline(in, text);  // names of the columns
  RepeatedLooks looks;
  while (std::getline(in, text)) {
    const RepeatedLook look = repeated_look_of(text);
    looks[look.index] = look;
  }
  return {fmt::format("{} pairs, {}", looks.size(), run), looks};
}

RepeatRates RepeatRates::read(const std::filesystem::path& path) {
  std::istringstream in(read_text_file(path, std::uint64_t{1} << 24));
  std::string text;
  std::getline(in, text);
  if (!text.starts_with(kStored)) {
    throw UsageError({.what = "not a table of repeated looks",
                      .where = path.string(),
                      .expected = std::string(kStored),
                      .found = text.substr(0, 80),
                      .fix = "make one: ./run bench integrity --part table"});
  }
  RepeatRates rates;
  rates.origin_ = text.substr(kStored.size());
  const auto numbers = [&text](auto& first, auto&... others) {
    std::istringstream cells(text);
    char comma = ',';
    cells >> first;
    ((comma == ',' ? cells >> comma >> others : cells), ...);
    if (!cells || comma != ',' || !(cells >> std::ws).eof()) {
      throw Error({.what = "a line of repeated looks cannot be read", .found = text});
    }
  };
  std::getline(in, text);  // names of the columns
  for (Bin& bin : rates.bins_) {
    double new_ground = 0;
    std::getline(in, text);
    numbers(new_ground, bin.chance, bin.disc, bin.ring, bin.same_side.of, bin.same_side.count);
  }
  std::getline(in, text);  // names of the columns
  while (std::getline(in, text)) {
    Again& p = rates.pairs_.emplace_back();
    numbers(p.first, p.second, p.moved_m);
  }
  rates.finish();
  return rates;
}

std::string RepeatRates::text() const {
  std::string text = fmt::format("{}{}\nnew_ground,chance,disc,ring,places,same_side\n", kStored, origin_);
  for (std::size_t i = 0; i < bins_.size(); ++i) {
    const Bin& b = bins_[i];
    text += fmt::format("{:g},{},{},{},{},{}\n", kNewGround[i], b.chance, b.disc, b.ring, b.same_side.of,
                        b.same_side.count);
  }
  text += "first_nats,second_nats,moved_m\n";
  for (const Again& p : pairs_) text += fmt::format("{:.2f},{:.2f},{:.1f}\n", p.first, p.second, p.moved_m);
  return text;
}

std::string RepeatRates::table() const {
  std::string table =
      "| new ground | chance peaks | another one in the disc | in the ring | seen again, % at most | true places twice "
      "| errors on the same side, % (95 %) |\n|---|---|---|---|---|---|---|\n";
  for (std::size_t i = 0; i < bins_.size(); ++i) {
    const Bin& b = bins_[i];
    table += fmt::format("| {:g} | {} | {} | {} | {:.0f} | {} | {:.0f} ({:.0f} to {:.0f}) |\n", kNewGround[i], b.chance,
                         b.disc, b.ring, 100 * again_[i], b.same_side.of, 100 * b.same_side.share(),
                         100 * b.same_side.lower(), 100 * b.same_side.upper());
  }
  return table +
         fmt::format("\nweight of evidence of a peak that is seen again: {:.2f} + {:.2f} ℓ\n", intercept_, slope_);
}

}  // namespace nadir::bench
