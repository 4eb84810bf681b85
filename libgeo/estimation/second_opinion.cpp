#include "estimation/second_opinion.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <optional>
#include <utility>

#include "base/error.hpp"
#include "estimation/second_likelihood_table.hpp"
#include "vision/dense_descriptors.hpp"

namespace nadir {

namespace opinion = parameters::second_opinion;

namespace {

bool is_agreement(SecondOutcome outcome) {
  return outcome == SecondOutcome::agrees || outcome == SecondOutcome::agrees_strongly;
}

bool has_candidate(const AnchorMatch& match) { return match.solved && !match.search.places.empty(); }

double upper_bound(int count) { return count + opinion::kRuleOfThree + opinion::kUpperSigmas * std::sqrt(count); }

class SecondOpinionMatcher final : public MapMatcher {
 public:
  SecondOpinionMatcher(const MatcherMap& map, SecondOpinion opinion)
      : how_(std::move(opinion)), first_(how_.first(map)), second_(how_.second(map)) {}

  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    AnchorMatch found = first_->match(grey, prior);
    const double side_m = 2 * prior.search.radius_m;
    return judged(std::move(found), grey, prior, side_m * side_m, false);
  }
  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    return judged(first_->match_anywhere(grey, prior, area), grey, prior, area.area_m2(), true);
  }
  AnchorMatch match_among(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area,
                          const SearchSuggestions& suggested) override {
    return judged(first_->match_among(grey, prior, area, suggested), grey, prior, area.area_m2(), true);
  }

 private:
  // lost: all of an area was searched. Then the second only confirms what the first has found.
  AnchorMatch judged(AnchorMatch found, const cv::Mat& grey, const AnchorPrior& prior, double area_m2, bool lost) {
    const bool candidate = has_candidate(found);
    if (second_ == nullptr || !found.on_map || (lost && !candidate)) return found;
    const double log_first = candidate ? log_likelihood_ratio(found, prior, area_m2) : 0;
    if (how_.use == SecondMatcherUse::automatic && candidate && prior.settles &&
        prior.settles(found, log_first + least_evidence(how_.table->first, log_first))) {
      return found;
    }
    AnchorPrior where = prior;
    if (lost) {
      where.search.radius_m = opinion::kConfirmedRadius_m;
      where.search.pose = found.search.places.front().pose;
      where.search.heading_range_rad = std::min(prior.search.heading_range_rad, kUnknownTurn_rad);
    }
    std::optional<AnchorMatch> other = ask(grey, where);
    if (!other) return found;
    return weigh(std::move(found), std::move(*other), prior, where, log_first, lost);
  }

  AnchorMatch weigh(AnchorMatch found, AnchorMatch other, const AnchorPrior& prior, const AnchorPrior& where,
                    double log_first, bool lost) const {
    const SecondLikelihoodTable& table = *how_.table;
    const double side_m = 2 * where.search.radius_m;
    const double log_second =
        has_candidate(other) ? nadir::log_likelihood_ratio(features_of(other, where, side_m * side_m), table.look) : 0;
    const bool may_replace = !lost && has_candidate(other) && inside(other, prior);
    const JointEvidence joint = joint_evidence(found, log_first, other, log_second, may_replace, table);
    AnchorMatch& judged = joint.of_second ? other : found;
    judged.judged_log_likelihood_ratio = joint.log_likelihood_ratio;
    return std::move(judged);
  }

  static bool inside(const AnchorMatch& match, const AnchorPrior& prior) {
    const PlanePoint at = match.search.places.front().pose.position, middle = prior.search.pose.position;
    return std::abs(at.east_m - middle.east_m) <= prior.search.radius_m &&
           std::abs(at.north_m - middle.north_m) <= prior.search.radius_m;
  }

  std::optional<AnchorMatch> ask(const cv::Mat& grey, const AnchorPrior& prior) {
    try {
      return second_->match(grey, prior);
    } catch (const Interrupted&) {
      throw;
    } catch (const std::exception& error) {
      // It must not cost the flight what the first one sees.
      second_.reset();
      if (how_.on_failure) how_.on_failure(error.what());
      return std::nullopt;
    }
  }

  SecondOpinion how_;
  std::unique_ptr<MapMatcher> first_, second_;
};

}  // namespace

std::size_t outcome_class(double log_likelihood_ratio) {
  const auto& limits = opinion::kFirstClasses;
  return static_cast<std::size_t>(
      std::count_if(limits.begin(), limits.end(), [&](double limit) { return log_likelihood_ratio >= limit; }));
}

double outcome_evidence(const OutcomeCounts& counts, double log_likelihood_ratio, SecondOutcome outcome) {
  using Row = std::array<int, OutcomeCounts::kOutcomes>;
  const auto total = [](const Row& row) { return std::accumulate(row.begin(), row.end(), 0.0); };
  const auto add = [](Row& sum, const Row& row) {
    std::transform(sum.begin(), sum.end(), row.begin(), sum.begin(), std::plus());
  };
  std::size_t row = outcome_class(log_likelihood_ratio);
  Row place = counts.place[row], chance = counts.chance[row];
  while (row > 0 && total(chance) == 0) {
    --row;
    add(place, counts.place[row]);
    add(chance, counts.chance[row]);
  }
  const double places = total(place), chances = total(chance);
  if (places == 0 || chances == 0) return 0;  // nothing was counted
  const auto column = static_cast<std::size_t>(outcome);
  // Each share to its safe side: an agreement says what its bound allows, a disagreement speaks against it fully.
  if (is_agreement(outcome)) {
    const double expected = place[column] / places, by_chance = std::min(1.0, upper_bound(chance[column]) / chances);
    return expected > 0 ? std::max(0.0, std::log(expected / by_chance)) : 0;
  }
  return std::min(0.0, std::log((place[column] + 1) / (places + 1)) - std::log((chance[column] + 1) / (chances + 1)));
}

double least_evidence(const OutcomeCounts& counts, double log_likelihood_ratio) {
  double least = 0;
  for (std::size_t i = 0; i < OutcomeCounts::kOutcomes; ++i) {
    least = std::min(least, outcome_evidence(counts, log_likelihood_ratio, static_cast<SecondOutcome>(i)));
  }
  return least;
}

SecondOutcome outcome_of(const AnchorMatch& of, const AnchorMatch& other, double other_log_likelihood_ratio) {
  if (!has_candidate(other) || !has_candidate(of)) return SecondOutcome::none;
  const double gsd_m = std::max(of.fine_gsd_m, other.fine_gsd_m);
  const bool same = distance_m(of.solved->pose.position, other.solved->pose.position) <=
                    opinion::kAgreement_cells * kDescriptorCell_px * gsd_m;
  const bool strong = other_log_likelihood_ratio >= opinion::kStrong;
  if (same) return strong ? SecondOutcome::agrees_strongly : SecondOutcome::agrees;
  return strong ? SecondOutcome::differs_strongly : SecondOutcome::differs;
}

JointEvidence joint_evidence(const AnchorMatch& first, double log_first, const AnchorMatch& second, double log_second,
                             bool may_replace, const SecondLikelihoodTable& table) {
  static_assert(opinion::kMostClaim < parameters::belief::kUnambiguous);
  JointEvidence joint;
  const double most = std::min(table.look.limit, opinion::kMostClaim);
  if (has_candidate(first)) {
    joint.log_likelihood_ratio =
        std::clamp(log_first + outcome_evidence(table.first, log_first, outcome_of(first, second, log_second)),
                   -table.look.limit, std::max(log_first, most));
  }
  const SecondOutcome of_second = outcome_of(second, first, log_first);
  if (!may_replace || !has_candidate(second) || is_agreement(of_second)) return joint;
  // Another place. Of the two the likelier one is the candidate.
  const double log_other =
      std::min(most, log_second + std::min(0.0, outcome_evidence(table.second, log_second, of_second)));
  if (joint.log_likelihood_ratio && *joint.log_likelihood_ratio >= log_other) return joint;
  return {.of_second = true, .log_likelihood_ratio = log_other};
}

const SecondLikelihoodTable& second_likelihood_table() { return kSecondLikelihoodTable; }

SecondMatcherCheck check_second_matcher(const NetworkFile& file, const std::vector<std::filesystem::path>& plugins,
                                        const std::function<double()>& processor_s,
                                        const SecondLikelihoodTable& table) {
  SecondMatcherCheck check;
  const auto warn = [&](const char* code, ErrorText text) {
    check.found = "not used: " + text.what;
    check.findings.add({.code = code,
                        .severity = Severity::warning,
                        .where = text.where.empty() ? file.model.string() : text.where,
                        .expected = text.expected,
                        .found = text.found.empty() ? text.what : fmt::format("{}: {}", text.what, text.found),
                        .fix = text.fix});
  };
  try {
    OpenedNetwork opened = open_network(file, plugins);
    if (opened.digest.hex() != table.network_sha256) {
      warn("matcher.uncalibrated", {.what = "nobody has measured how often this network is wrong",
                                    .expected = fmt::format("the network with SHA-256 {}", table.network_sha256),
                                    .found = opened.digest.hex(),
                                    .fix = "use that network, or measure this one (docs/second-matcher.md)"});
      return check;
    }
    const double cost_ms = network_cost_ms(*opened.network, processor_s);
    if (!(cost_ms <= opinion::kMostFrame_ms)) {
      warn("matcher.slow", {.what = "the network is too slow on this machine",
                            .expected = fmt::format("at most {:g} ms for a frame", opinion::kMostFrame_ms),
                            .found = fmt::format("{:.0f} ms", cost_ms),
                            .fix = "fly without it: leave the model out"});
      return check;
    }
    check.found = fmt::format("{}, {}, {:.0f} ms", opened.network->name(), opened.runtime, cost_ms);
    check.network = std::move(opened.network);
  } catch (const Error& error) {
    warn("matcher.unusable", error.text());
  }
  return check;
}

std::optional<SecondMatcherUse> second_matcher_use(std::string_view name) {
  if (name == "auto") return SecondMatcherUse::automatic;
  if (name == "always") return SecondMatcherUse::always;
  if (name == "never") return SecondMatcherUse::never;
  return std::nullopt;
}

std::pair<std::string, std::string> second_matcher_setting(const std::string& network, SecondMatcherUse use) {
  const char* how = use == SecondMatcherUse::automatic ? "auto" : use == SecondMatcherUse::always ? "always" : "never";
  return {"second_matcher", fmt::format("{} {}", how, network)};
}

MapMatcherFactory make_second_opinion(SecondOpinion opinion) {
  return [opinion = std::move(opinion)](const MatcherMap& map) {
    return std::make_unique<SecondOpinionMatcher>(map, opinion);
  };
}

}  // namespace nadir
