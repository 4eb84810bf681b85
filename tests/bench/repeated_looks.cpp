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

constexpr std::string_view kFormat = "# nadir repeated looks, ";

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

bool RepeatedLook::seen_again() const {
  if (!first.candidate || !second.candidate) return false;
  const double variance_m2 = first.sigma_m * first.sigma_m + second.sigma_m * second.sigma_m;
  return (second.off_m - first.off_m).squaredNorm() <= parameters::belief::kChi2_999 * variance_m2;
}

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

RepeatedLooks read_repeated_looks(const std::filesystem::path& path) {
  std::istringstream in(read_text_file(path, std::uint64_t{1} << 28));
  std::string text;
  std::getline(in, text);
  if (!text.starts_with(kFormat)) {
    throw UsageError({.what = "not a file of repeated looks",
                      .where = path.string(),
                      .expected = std::string(kFormat),
                      .found = text.substr(0, 80),
                      .fix = "make one: ./run bench integrity --part repeats --resume FILE"});
  }
  std::getline(in, text);  // names of the columns
  RepeatedLooks looks;
  while (std::getline(in, text)) {
    const RepeatedLook look = repeated_look_of(text);
    looks[look.index] = look;
  }
  return looks;
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

RepeatRates::RepeatRates(const RepeatedLooks& looks) {
  for (const auto& [index, look] : looks) {
    Bin& bin = bins_[bin_of(look.new_ground)];
    if (look.chance_first()) {
      const bool strong = look.first.log_likelihood_ratio > 0;
      CountedShare& share = strong ? strong_again_[strong_bin_of(look.new_ground)] : bin.weak_again;
      ++share.of;
      if (!look.seen_again()) continue;
      ++share.count;
      changes_[strong ? 1 : 0].push_back({look.second.log_likelihood_ratio - look.first.log_likelihood_ratio,
                                          (look.second.off_m - look.first.off_m).norm() / unit_of(look.ground)});
    } else if (look.first.right && look.second.right) {
      ++bin.same_side.of;
      bin.same_side.count += look.first.off_m.dot(look.second.off_m) > 0 ? 1 : 0;
    }
  }
  for (std::size_t i = 0; i < bins_.size(); ++i) {
    weak_upper_[i] = bins_[i].weak_again.upper();
    stays_[i] = std::max(0.0, 2 * bins_[i].same_side.upper() - 1);
  }
  for (std::size_t i = 0; i < strong_again_.size(); ++i) strong_upper_[i] = strong_again_[i].upper();
  for (const auto& changes : changes_) {
    if (changes.empty()) {
      throw Error({.what = "no chance peak of a kind was seen twice: nothing to draw its change from",
                   .fix = "measure more: ./run bench integrity --part repeats"});
    }
  }
}

double RepeatRates::again(double new_ground, bool strong) const {
  return strong ? strong_upper_[strong_bin_of(new_ground)] : weak_upper_[bin_of(new_ground)];
}

std::string RepeatRates::table() const {
  std::string table =
      "| new ground | chance peaks with ℓ ≤ 0 | seen again, % (95 %) | with ℓ > 0 | seen again, % (95 %) | true "
      "places twice | errors on the same side, % (95 %) |\n|---|---|---|---|---|---|---|\n";
  const auto cell = [](const CountedShare& s) {
    return s.of == 0 ? std::string("-")
                     : fmt::format("{:.1f} ({:.1f} to {:.1f})", 100 * s.share(), 100 * s.lower(), 100 * s.upper());
  };
  for (const double new_ground : kNewGround) {
    const Bin& b = bin(new_ground);
    const CountedShare& strong = strong_again(new_ground);
    table += fmt::format("| {:g} | {} | {} | {} | {} | {} | {} |\n", new_ground, b.weak_again.of, cell(b.weak_again),
                         strong.of, cell(strong), b.same_side.of, cell(b.same_side));
  }
  return table;
}

}  // namespace nadir::bench
