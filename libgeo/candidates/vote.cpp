#include "candidates/vote.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>

#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

std::int64_t day_of(const CandidateSidecar& sidecar) { return sidecar.captured_at.unix_ms / kDay_ms; }

bool newer(const AcceptedCandidate* a, const AcceptedCandidate* b) {
  if (a->sidecar.captured_at != b->sidecar.captured_at) return a->sidecar.captured_at > b->sidecar.captured_at;
  return a->tile < b->tile;
}

// The best tile of each flight, newest first.
std::vector<const AcceptedCandidate*> best_of_each_flight(const AddressCandidates& address) {
  std::vector<const AcceptedCandidate*> flights;
  for (const AcceptedCandidate& candidate : address.candidates) {
    const auto same = std::find_if(flights.begin(), flights.end(), [&candidate](const AcceptedCandidate* other) {
      return other->sidecar.airframe == candidate.sidecar.airframe && other->sidecar.flight == candidate.sidecar.flight;
    });
    if (same == flights.end()) {
      flights.push_back(&candidate);
    } else if (cost_mm(candidate.sidecar) < cost_mm((*same)->sidecar)) {
      *same = &candidate;
    }
  }
  std::sort(flights.begin(), flights.end(), newer);
  return flights;
}

// The flights that are compared, newest first. They are chosen in rounds: first the newest flight of each airframe,
// then the second newest of each, up to the limit. So a key that signs any number of flights displaces one flight of
// the others, not all of them.
std::vector<const AcceptedCandidate*> selected_flights(const AddressCandidates& address) {
  const std::vector<const AcceptedCandidate*> flights = best_of_each_flight(address);
  struct RankedFlight {
    std::size_t round;
    const AcceptedCandidate* flight;
  };
  std::map<std::string_view, std::size_t> of_airframe;
  std::vector<RankedFlight> ranked;
  for (const AcceptedCandidate* flight : flights) ranked.push_back({of_airframe[flight->sidecar.airframe]++, flight});
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const RankedFlight& a, const RankedFlight& b) { return a.round < b.round; });
  if (ranked.size() > kMaxIndependentFlights) ranked.resize(kMaxIndependentFlights);
  std::vector<const AcceptedCandidate*> selected;
  for (const RankedFlight& one : ranked) selected.push_back(one.flight);
  std::sort(selected.begin(), selected.end(), newer);
  return selected;
}

// Stored votes and new ones.
class Votes {
 public:
  Votes(const AddressCandidates& address, const CompareImages& compare, std::vector<Vote>& taken)
      : known_(address.votes), compare_(compare), taken_(taken) {}

  const Vote& between(const AcceptedCandidate& a, const AcceptedCandidate& b) {
    const AcceptedCandidate &one = a.tile < b.tile ? a : b, &other = a.tile < b.tile ? b : a;
    const auto found = std::find_if(known_.begin(), known_.end(), [&](const Vote& vote) {
      return vote.tile == one.tile && vote.other == other.tile;
    });
    if (found != known_.end()) return *found;
    Vote vote = compare_(one, other);
    vote.tile = one.tile, vote.other = other.tile;
    taken_.push_back(vote);
    return known_.emplace_back(vote);
  }

 private:
  std::vector<Vote> known_;
  const CompareImages& compare_;
  std::vector<Vote>& taken_;
};

// The largest group of independent flights that contains a given flight as its newest and in which every pair agrees.
// Not the first group found: a flight that agrees with only one genuine flight must not split a larger group.
class AgreeingGroup {
 public:
  AgreeingGroup(std::span<const AcceptedCandidate* const> flights, Votes& votes, const CandidateRules& rules)
      : flights_(flights), votes_(votes), rules_(rules) {}

  std::vector<const AcceptedCandidate*> around(std::size_t first) {
    largest_.clear();
    group_ = {flights_[first]};
    extend(first + 1);
    return largest_;
  }

 private:
  void extend(std::size_t next) {
    if (group_.size() > largest_.size()) largest_ = group_;
    for (std::size_t i = next; i < flights_.size(); ++i) {
      if (group_.size() + flights_.size() - i <= largest_.size()) return;  // too few are left
      if (!fits(*flights_[i])) continue;
      group_.push_back(flights_[i]);
      extend(i + 1);
      group_.pop_back();
    }
  }
  bool fits(const AcceptedCandidate& flight) {
    return std::all_of(group_.begin(), group_.end(), [&](const AcceptedCandidate* member) {
      return independent(member->sidecar, flight.sidecar, rules_) && votes_.between(*member, flight).agrees;
    });
  }

  std::span<const AcceptedCandidate* const> flights_;
  Votes& votes_;
  const CandidateRules& rules_;
  std::vector<const AcceptedCandidate*> group_, largest_;
};

// The n-th smallest sigma of the group, n being the number of flights needed: a smaller one is claimed by too few of
// them.
std::int64_t corroborated_sigma_mm(std::span<const AcceptedCandidate* const> group, const CandidateRules& rules) {
  std::vector<std::int64_t> sigmas_mm;
  for (const AcceptedCandidate* candidate : group) sigmas_mm.push_back(candidate->sidecar.pose.sigma_mm);
  std::sort(sigmas_mm.begin(), sigmas_mm.end());
  return sigmas_mm[static_cast<std::size_t>(rules.flights_to_promote) - 1];
}

std::string evidence_of(const AcceptedCandidate& promoted, std::span<const AcceptedCandidate* const> group,
                        Votes& votes, const CandidateRules& rules) {
  nlohmann::json evidence{{"needed", rules.flights_to_promote},
                          {"sigma_mm", corroborated_sigma_mm(group, rules)},
                          {"flights", nlohmann::json::array()}};
  for (const AcceptedCandidate* candidate : group) {
    nlohmann::json flight{{"airframe", candidate->sidecar.airframe},
                          {"flight", candidate->sidecar.flight},
                          {"base_package", candidate->sidecar.base_package.hex()},
                          {"sha256", candidate->sidecar.sha256.hex()},
                          {"captured_at", to_rfc3339(candidate->sidecar.captured_at)}};
    if (candidate != &promoted) {
      const Vote& vote = votes.between(promoted, *candidate);
      flight["shift_mm"] = vote.shift_mm;
      flight["allowed_mm"] = vote.allowed_mm;
      flight["correlation_ppm"] = vote.correlation_ppm;
    }
    evidence["flights"].push_back(std::move(flight));
  }
  return evidence.dump();
}

}  // namespace

bool independent(const CandidateSidecar& one, const CandidateSidecar& other, const CandidateRules& rules) {
  if (one.airframe != other.airframe) return true;
  // A flight across midnight that was restarted in the air has two names and two dates, and is still one flight.
  const std::int64_t apart_ms = std::abs(one.captured_at.unix_ms - other.captured_at.unix_ms);
  return !rules.airframes_differ && one.flight != other.flight && day_of(one) != day_of(other) &&
         apart_ms >= rules.apart_ms;
}

std::int64_t allowed_shift_mm(double sigma_one_mm, double sigma_other_mm, const CandidateRules& rules) {
  return std::max(rules.floor_mm, static_cast<std::int64_t>(rules.sigmas * hypotenuse(sigma_one_mm, sigma_other_mm)));
}

Outcome decide(const AddressCandidates& address, const CompareImages& compare, std::int64_t now_ms,
               const CandidateRules& rules) {
  Outcome outcome;
  const std::vector<const AcceptedCandidate*> flights = selected_flights(address);
  Votes votes(address, compare, outcome.new_votes);
  AgreeingGroup groups(flights, votes, rules);
  for (std::size_t first = 0; first < flights.size(); ++first) {
    const std::vector<const AcceptedCandidate*> group = groups.around(first);
    if (std::ssize(group) < rules.flights_to_promote) continue;
    const AcceptedCandidate& best =
        **std::min_element(group.begin(), group.end(), [](const AcceptedCandidate* a, const AcceptedCandidate* b) {
          return cost_mm(a->sidecar) < cost_mm(b->sidecar);
        });
    std::string evidence = evidence_of(best, group, votes, rules);
    if (address.promoted != best.tile || address.evidence != evidence) {
      outcome.promotion = {.tile = best.tile,
                           .key = address.key,
                           .decided_ms = now_ms,
                           .flights = std::ssize(group),
                           .evidence = std::move(evidence)};
    }
    break;
  }
  return outcome;
}

}  // namespace nadir
