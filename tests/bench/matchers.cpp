// Map matchers side by side, at the same looks: how often each is right, how sure, at what cost, and how far two of
// them err together. Takes the results of `./run bench looks --matcher`; with --write it counts the table by which a
// second matcher is a witness (estimation/second_opinion.hpp).
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <iostream>
#include <numeric>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "counted_share.hpp"
#include "estimation/second_opinion.hpp"
#include "likelihood_fit.hpp"
#include "look.hpp"

using namespace nadir;
using namespace nadir::bench;

namespace {

struct Results {
  std::string matcher;
  LooksFile file;
};

Results read_results(const std::filesystem::path& path) {
  static constexpr std::string_view kMatcher = ", matcher ";
  Results results{{}, read_looks(path)};
  const std::size_t at = results.file.run.find(kMatcher);
  if (at == std::string::npos) {
    throw UsageError({.what = "these looks name no matcher",
                      .where = path.string(),
                      .fix = "take them with ./run bench looks --matcher NAME --resume FILE"});
  }
  results.matcher = results.file.run.substr(at + kMatcher.size());
  results.file.run.resize(at);
  return results;
}

// The kind of ground: all years of one place and all pairs are one row.
std::string set_of(const Look& look) {
  for (const char* set : {"painted", "naip", "pair", "arroio flight", "arroio", "fengyuan"}) {
    if (look.ground.starts_with(set)) return set;
  }
  return look.ground;
}

// How sure a matcher is, by what all of them have.
double sureness(const Look& look) { return look.features.score * (1 - look.features.ratio); }

std::vector<std::uint64_t> common(const std::vector<Results>& all) {
  std::vector<std::uint64_t> indices;
  for (const auto& [index, look] : all.front().file.looks) {
    const bool everywhere = std::all_of(all.begin(), all.end(), [&](const Results& results) {
      const auto found = results.file.looks.find(index);
      return found != results.file.looks.end() && found->second.ground == look.ground &&
             found->second.window == look.window;
    });
    if (everywhere) indices.push_back(index);
  }
  return indices;
}

struct Tally {
  int holds = 0, right = 0, clean = 0;
};

Tally tally(const LooksFile& file, const std::vector<std::uint64_t>& indices) {
  double surest_wrong = 0;
  for (const std::uint64_t index : indices) {
    const Look& look = file.looks.at(index);
    if (look.candidate() && !look.right()) surest_wrong = std::max(surest_wrong, sureness(look));
  }
  Tally counts;
  for (const std::uint64_t index : indices) {
    const Look& look = file.looks.at(index);
    if (look.window != "right") continue;
    ++counts.holds, counts.right += look.right() ? 1 : 0;
    counts.clean += look.right() && sureness(look) > surest_wrong ? 1 : 0;
  }
  return counts;
}

void print_tallies(const std::vector<Results>& all, const std::vector<std::uint64_t>& indices,
                   std::string (*name)(const Look&)) {
  std::map<std::string, std::vector<std::uint64_t>> groups;
  for (const std::uint64_t index : indices) groups[name(all.front().file.looks.at(index))].push_back(index);
  groups["all"] = indices;
  std::string head = "| looks | hold the place |", line = "|---|---|";
  for (const Results& results : all) {
    head += fmt::format(" {}: right | clean |", results.matcher);
    line += "---|---|";
  }
  std::cout << head << "\n" << line << "\n";
  for (const auto& [group, members] : groups) {
    std::string row;
    int holds = 0;
    for (const Results& results : all) {
      const Tally counts = tally(results.file, members);
      holds = counts.holds;
      row += fmt::format(" {} | {} |", counts.right, counts.clean);
    }
    std::cout << fmt::format("| {} | {} |{}\n", group, holds, row);
  }
  std::cout << "\n";
}

void print_costs(const std::vector<Results>& all, const std::vector<std::uint64_t>& indices) {
  std::cout << "| matcher | CPU ms a look, mean | half of the right ones within m |\n|---|---|---|\n";
  for (const Results& results : all) {
    double spent_ms = 0;
    std::vector<double> errors_m;
    for (const std::uint64_t index : indices) {
      const Look& look = results.file.looks.at(index);
      spent_ms += look.cpu_ms;
      if (look.right()) errors_m.push_back(look.error_m);
    }
    std::sort(errors_m.begin(), errors_m.end());
    std::cout << fmt::format("| {} | {:.0f} | {:.1f} |\n", results.matcher,
                             spent_ms / static_cast<double>(indices.size()),
                             errors_m.empty() ? 0 : errors_m[errors_m.size() / 2]);
  }
  std::cout << "\n";
}

// What the evidence needs of a match.
AnchorMatch match_of(const Look& look) {
  AnchorMatch match;
  match.fine_gsd_m = look.fine_gsd_m;
  if (!look.candidate()) return match;
  match.search.places.emplace_back();
  match.solved.emplace().pose.position = PlanePoint(look.off_m);
  return match;
}

SecondOutcome outcome(const Look& of, const Look& other, double other_log_likelihood_ratio) {
  return outcome_of(match_of(of), match_of(other), other_log_likelihood_ratio);
}

// What a look comes to with both matchers, or with the first alone.
struct Evidence {
  bool candidate = false, right = false;
  double ratio = 0;  // Λ; 0: no candidate
};

Evidence evidence_of(const Look& one, const Look& two, bool with_second, const SecondLikelihoodTable& table) {
  const double log_first = one.candidate() ? log_likelihood_ratio(one.features, look_likelihood_table()) : 0;
  JointEvidence joint{false, one.candidate() ? std::optional(log_first) : std::nullopt};
  if (with_second) {
    const double log_second = two.candidate() ? log_likelihood_ratio(two.features, table.look) : 0;
    joint = joint_evidence(match_of(one), log_first, match_of(two), log_second, two.candidate(), table);
  }
  if (!joint.log_likelihood_ratio) return {};
  return {true, joint.of_second ? two.right() : one.right(), std::exp(*joint.log_likelihood_ratio)};
}

std::string percent(const CountedShare& share) {
  return fmt::format("{:.3g} ({:.2g} to {:.2g}; {})", 100 * share.share(), 100 * share.lower(), 100 * share.upper(),
                     share.count);
}

// How often looks that cannot be right claim to be, and how often the others say what they see, by the first matcher
// alone and by both in every look. The mean ratio of looks that cannot be right is 1 at most where the evidence is
// honest.
void print_joint(const Results& first, const Results& second, const SecondLikelihoodTable& table,
                 const std::vector<std::uint64_t>& indices) {
  static constexpr std::array kRatios = {10.0, 100.0, 1000.0};
  for (const bool holds : {false, true}) {
    std::cout << fmt::format(
        "| {} | number | {} | above 10, % (95 % bounds; number) | above 100, % | above 1000, % | mean ratio |\n"
        "|---|---|---|---|---|---|---|\n",
        holds ? "looks that hold their place" : "looks that cannot be right",
        holds ? "candidate is the place, %" : "candidates");
    for (const bool with_second : {false, true}) {
      int looks = 0, candidates = 0;
      std::array<int, kRatios.size()> above{};
      double sum = 0;
      for (const std::uint64_t index : indices) {
        const Look &one = first.file.looks.at(index), &two = second.file.looks.at(index);
        if ((one.holds_place() || two.holds_place()) != holds) continue;
        ++looks;
        const Evidence found = evidence_of(one, two, with_second, table);
        if (!found.candidate || found.right != holds) continue;
        ++candidates, sum += found.ratio;
        for (std::size_t i = 0; i < kRatios.size(); ++i) above[i] += found.ratio > kRatios[i] ? 1 : 0;
      }
      std::cout << fmt::format("| {} | {} | {} |", with_second ? "with the second" : "the first alone", looks,
                               holds ? percent({candidates, looks}) : std::to_string(candidates));
      for (const int count : above) std::cout << fmt::format(" {} |", percent({count, looks}));
      std::cout << fmt::format(" {:.3g} |\n", sum / std::max(1, looks));
    }
    std::cout << "\n";
  }
  // Where the place is held and another is found.
  std::cout
      << "| looks that hold their place and find another | above 10 | above 100 | above 1000 |\n|---|---|---|---|\n";
  for (const bool with_second : {false, true}) {
    int wrong = 0;
    std::array<int, kRatios.size()> above{};
    for (const std::uint64_t index : indices) {
      const Look &one = first.file.looks.at(index), &two = second.file.looks.at(index);
      const Evidence found = evidence_of(one, two, with_second, table);
      if (!(one.holds_place() || two.holds_place()) || !found.candidate || found.right) continue;
      ++wrong;
      for (std::size_t i = 0; i < kRatios.size(); ++i) above[i] += found.ratio > kRatios[i] ? 1 : 0;
    }
    std::cout << fmt::format("| {}: {} | {} |\n", with_second ? "with the second" : "the first alone", wrong,
                             fmt::join(above, " | "));
  }
  std::cout << "\n";
}

OutcomeCounts count_outcomes(const LooksFile& of, const LookLikelihoodTable& of_table, const LooksFile& other,
                             const LookLikelihoodTable& other_table, const std::vector<std::uint64_t>& indices) {
  OutcomeCounts counts;
  for (const std::uint64_t index : indices) {
    const Look &look = of.looks.at(index), &second = other.looks.at(index);
    if (!look.candidate()) continue;
    const double log_other = second.candidate() ? log_likelihood_ratio(second.features, other_table) : 0;
    const auto row = outcome_class(log_likelihood_ratio(look.features, of_table));
    const auto column = static_cast<std::size_t>(outcome(look, second, log_other));
    ++(look.right() ? counts.place : counts.chance)[row][column];
  }
  return counts;
}

// The rare chance peaks that spoke for themselves, beside those of the looks that were drawn: all of a much larger set
// (./run bench looks --chance-peaks-of). Given that the first has such a peak, what the second sees is what it would
// see in any look, so the counts may be added.
void add_chance_peaks(OutcomeCounts& counts, const LooksFile& first, const LooksFile& second,
                      const LookLikelihoodTable& own) {
  for (const auto& [index, look] : first.looks) {
    const auto other = second.looks.find(index);
    if (other == second.looks.end() || !look.candidate() || look.right()) continue;
    const auto row = outcome_class(log_likelihood_ratio(look.features, look_likelihood_table()));
    if (row == 0) continue;
    const double log_other = other->second.candidate() ? log_likelihood_ratio(other->second.features, own) : 0;
    ++counts.chance[row][static_cast<std::size_t>(outcome(look, other->second, log_other))];
  }
}

void print_counts(const std::string& title, const OutcomeCounts& counts) {
  std::cout << fmt::format(
      "| {} | ln Λ | agrees strongly | agrees | none | differs | differs strongly |\n|---|---|---|---|---|---|---|\n",
      title);
  static constexpr std::array kClasses = {"below 0", "to 3.5", "above"};
  for (const bool place : {true, false}) {
    for (std::size_t row = 0; row < kClasses.size(); ++row) {
      const auto& numbers = (place ? counts.place : counts.chance)[row];
      std::cout << fmt::format("| {} | {} | {} |\n", place ? "the place" : "a chance peak", kClasses[row],
                               fmt::join(numbers, " | "));
    }
  }
  for (std::size_t row = 0; row < kClasses.size(); ++row) {
    std::vector<std::string> evidence;
    for (std::size_t column = 0; column < OutcomeCounts::kOutcomes; ++column) {
      const double middle = row == 0 ? -1 : row == 1 ? 1 : 5;
      evidence.push_back(fmt::format("{:+.2f}", outcome_evidence(counts, middle, static_cast<SecondOutcome>(column))));
    }
    std::cout << fmt::format("| evidence, nats | {} | {} |\n", kClasses[row], fmt::join(evidence, " | "));
  }
  std::cout << "\n";
}

void print_agreement(const Results& first, const Results& second, const std::vector<std::uint64_t>& indices) {
  int both = 0, only_first = 0, only_second = 0, neither = 0, agree = 0, agree_right = 0, chance = 0, chance_agree = 0;
  for (const std::uint64_t index : indices) {
    const Look &one = first.file.looks.at(index), &two = second.file.looks.at(index);
    const SecondOutcome seen = outcome(one, two, 0);
    if (one.candidate() && seen == SecondOutcome::agrees) ++agree, agree_right += one.right() && two.right() ? 1 : 0;
    if (one.candidate() && !one.right()) ++chance, chance_agree += seen == SecondOutcome::agrees ? 1 : 0;
    if (one.window != "right") continue;
    ++(one.right() && two.right() ? both : one.right() ? only_first : two.right() ? only_second : neither);
  }
  std::cout << fmt::format(
      "{} and {}, where the window holds the place: both right {}, only the first {}, only the second {}, neither {}.\n"
      "In all windows they agree {} times, and {} of these are wrong. Where the first has a chance peak, the second "
      "agrees "
      "in {} of {} looks ({:.1f} %).\n\n",
      first.matcher, second.matcher, both, only_first, only_second, neither, agree, agree - agree_right, chance_agree,
      chance, 100.0 * chance_agree / std::max(1, chance));
}

std::string text_of(const OutcomeCounts::Counts& counts) {
  std::vector<std::string> rows;
  for (const auto& row : counts) rows.push_back(fmt::format("{{{}}}", fmt::join(row, ", ")));
  return fmt::format("{{{{{}}}}}", fmt::join(rows, ", "));
}

PictureKind picture_kind(const Look& look) {
  const auto kind = std::find(kPictureKinds.begin(), kPictureKinds.end(), look.picture);
  if (kind == kPictureKinds.end()) throw Error({.what = "no kind of picture", .found = look.picture});
  return static_cast<PictureKind>(kind - kPictureKinds.begin());
}

std::string table_source(const std::string& sha256, const std::string& training, const LookLikelihoodTable& look,
                         const OutcomeCounts& first, const OutcomeCounts& second) {
  return fmt::format(
      R"(// Made by `./run bench matchers --write`; never edited by hand. second_opinion.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/second_opinion.hpp"

namespace nadir {{

inline constexpr SecondLikelihoodTable kSecondLikelihoodTable{{
.network_sha256 = "{}",
.training = "{}",
.look = {},
.first = {{.place = {}, .chance = {}}},
.second = {{.place = {}, .chance = {}}},
}};

}}  // namespace nadir
)",
      sha256, training, table_initializer(look), text_of(first.place), text_of(first.chance), text_of(second.place),
      text_of(second.chance));
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Map matchers side by side, and the table of a second one.", "matchers");
  std::vector<std::filesystem::path> files;
  std::vector<std::filesystem::path> rare;
  std::filesystem::path table, model;
  app.add_option("FILES", files,
                 "results of ./run bench looks --matcher, of the same looks; the first two are compared")
      ->required()
      ->expected(1, 8);
  app.add_option("--chance-peaks", rare,
                 "with --write: looks of --chance-peaks-of by the first and the second, pair by pair; counted as well");
  app.add_option("--write", table, "count the table of the second as a witness of the first, and write it here");
  app.add_option("--model", model, "with --write: the second's network, whose digest the table names");
  CLI11_PARSE(app, argc, argv);
  try {
    std::vector<Results> all;
    for (const std::filesystem::path& file : files) all.push_back(read_results(file));
    const std::vector<std::uint64_t> indices = common(all);
    if (indices.empty()) throw UsageError({.what = "the files have no look in common"});
    std::cout << fmt::format("{} looks; {}\n\n", indices.size(), all.front().file.run);
    print_tallies(all, indices, set_of);
    print_tallies(all, indices, [](const Look& look) { return look.picture; });
    print_costs(all, indices);
    if (all.size() < 2) return 0;
    print_agreement(all[0], all[1], indices);
    const LooksFile &first = all[0].file, &second = all[1].file;
    std::unique_ptr<FittedLikelihood> fitted;
    if (!table.empty()) {
      TrainingSet set{fmt::format("{} looks, {}, grounds: {}", indices.size(), second.run, second.grounds), {}};
      for (const std::uint64_t index : indices) {
        const Look& look = second.looks.at(index);
        set.looks.push_back({look.candidate(), look.holds_place(), look.right(), picture_kind(look), look.features});
      }
      fitted = fit(set, sha256(as_bytes(packed(set))).hex());
    }
    const LookLikelihoodTable& own = fitted ? fitted->table : second_likelihood_table().look;
    OutcomeCounts of_first = count_outcomes(first, look_likelihood_table(), second, own, indices);
    for (std::size_t i = 0; i + 1 < rare.size(); i += 2) {
      add_chance_peaks(of_first, read_results(rare[i]).file, read_results(rare[i + 1]).file, own);
    }
    const OutcomeCounts of_second = count_outcomes(second, own, first, look_likelihood_table(), indices);
    print_counts(all[0].matcher, of_first);
    print_counts(all[1].matcher, of_second);
    SecondLikelihoodTable judged = second_likelihood_table();
    if (fitted) {
      judged.look = own;
      judged.first = of_first;
      judged.second = of_second;
    }
    print_joint(all[0], all[1], judged, indices);
    if (!fitted) return 0;
    write_file_atomic(table, table_source(sha256_file(model).hex(), fitted->training, own, of_first, of_second));
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "matchers: " << error.what() << "\n";
    return 2;
  }
}
