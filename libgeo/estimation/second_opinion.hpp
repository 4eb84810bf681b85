// A second matcher as a witness: what it sees changes how much the first one's match says.
//
// The first matcher (oriented channels) finds a candidate z₁ with ℓ₁ = ln Λ, the likelihood ratio of true place over
// chance peak (look_likelihood.hpp). Where that is doubtful, a second matcher that compares something else
// (descriptor_matcher.hpp) searches the same window. Its outcome o is one of
//
//   agrees (strongly, weakly)    its candidate z₂ is the same place
//   none                         it has no candidate
//   differs (weakly, strongly)   z₂ is another place;  strongly: ln Λ₂ ≥ kStrong by its own table
//
// and is evidence on z₁ of its own: ℓ = ℓ₁ + ln r,   r = P(o | z₁ is the place, class of ℓ₁) / P(o | z₁ is a chance
// peak, class of ℓ₁).
//
// Two matchers that look at the same pictures do not err independently: where a chance peak resembles the frame for
// one, it may for the other. So r is not Λ₂. It is counted, from looks with known answers at which both looked, and
// given the class of ℓ₁: how often the second agrees with the first where the first is right, and how often where it is
// wrong. Counts are bounded to the safe side: of an agreement P(o | chance) is its upper bound (95 %). A disagreement
// never makes anything surer: r is at most 1 then, and agreeing at a chance peak is what it takes to be wrong.
//
// The class matters: looks that show little to the first show little to the second as well. Its silence says much
// against a match that is sure of itself, and next to nothing against a weak one, which at night or over an old map is
// all that there is.
//
// Where the first has no candidate or differs, the second's candidate counts with ln Λ₂ of its own table, less what the
// first's silence or contradiction says against it (the same counts, with the two exchanged). The likelier of both is
// the look's candidate. A chance peak then claims a ratio of t with the probability of both together at most; that the
// mean ratio of looks that cannot be right stays below one, as the bound P(Λ > t | chance) <= 1 / t needs, is measured
// (docs/second-matcher.md).
//
// All of these numbers belong to one network: second_likelihood_table.hpp, written by `./run bench matchers`, names its
// digest. A network that is not the one of the table is never asked.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "estimation/look_likelihood.hpp"
#include "vision/map_matcher.hpp"
#include "vision/network_plugin.hpp"

namespace nadir {

enum class SecondMatcherUse {
  automatic,  // where its answer may matter
  always,     // in every look; for measurements
  never,
};

// Of one matcher's candidate, by what the other one made of the same look.
enum class SecondOutcome : std::size_t { agrees_strongly, agrees, none, differs, differs_strongly };

// How often each outcome was seen, by class of the judged candidate's ln Λ.
struct OutcomeCounts {
  static constexpr std::size_t kOutcomes = 5, kClasses = 3;
  using Counts = std::array<std::array<int, kOutcomes>, kClasses>;
  Counts place{};   // the candidate was the true place
  Counts chance{};  // a chance peak
};

struct SecondLikelihoodTable {
  std::string_view network_sha256;  // of the model; empty: nothing is calibrated
  std::string_view training;        // looks that it was counted from
  LookLikelihoodTable look;         // Λ₂
  OutcomeCounts first;              // of the first matcher's candidates, by the second's outcome
  OutcomeCounts second;             // and the reverse
};

// The row of a candidate's ln Λ in the counts.
std::size_t outcome_class(double log_likelihood_ratio);

// ln r, nats, by the counts of the candidate's class; where none of them was a chance peak, those of the class below
// count as well.
double outcome_evidence(const OutcomeCounts& counts, double log_likelihood_ratio, SecondOutcome outcome);

// The least that any outcome makes of it, at most 0.
double least_evidence(const OutcomeCounts& counts, double log_likelihood_ratio);

// of: the candidate that is judged. Both with their ln Λ; either may have no solved pose.
SecondOutcome outcome_of(const AnchorMatch& of, const AnchorMatch& other, double other_log_likelihood_ratio);

// What both matches of one look come to: the candidate that counts, and its ln Λ.
struct JointEvidence {
  bool of_second = false;                      // the second's candidate; else the first's
  std::optional<double> log_likelihood_ratio;  // none: neither has a candidate
};
// may_replace: the second's candidate may take the place of the first's.
JointEvidence joint_evidence(const AnchorMatch& first, double log_first, const AnchorMatch& second, double log_second,
                             bool may_replace, const SecondLikelihoodTable& table);

// The one in force.
const SecondLikelihoodTable& second_likelihood_table();

// The first matcher with the second as its witness: matches are judged where the second was asked, and as before where
// it was not. After an error of the second it is not asked again; on_failure is called once, on the thread that
// matches.
struct SecondOpinion {
  MapMatcherFactory first = make_channel_matcher, second;
  SecondMatcherUse use = SecondMatcherUse::automatic;
  const SecondLikelihoodTable* table = &second_likelihood_table();
  std::function<void(const std::string& reason)> on_failure{};
};
MapMatcherFactory make_second_opinion(SecondOpinion opinion);

// A model as a second matcher: opened, tried, timed, and whether it is the one of the table. Whatever is wrong is a
// warning, because a flight does without: matcher.unusable, matcher.slow, matcher.uncalibrated.
struct SecondMatcherCheck {
  std::shared_ptr<DenseDescriptorNetwork> network;  // null: not to be used
  std::string found;  // for people: "xfeat.onnx (7dd154e1236c), ONNX Runtime 1.32.0, 3 ms"
  Findings findings;
};
// processor_s: seconds of processor time so far.
SecondMatcherCheck check_second_matcher(const NetworkFile& file, const std::vector<std::filesystem::path>& plugins,
                                        const std::function<double()>& processor_s,
                                        const SecondLikelihoodTable& table = second_likelihood_table());

std::optional<SecondMatcherUse> second_matcher_use(std::string_view name);  // auto, always, never
// For a recording, which can be replayed bit for bit only with the same one: {"second_matcher", "auto xfeat.onnx
// (7dd154e1236c)"}.
std::pair<std::string, std::string> second_matcher_setting(const std::string& network, SecondMatcherUse use);

}  // namespace nadir
