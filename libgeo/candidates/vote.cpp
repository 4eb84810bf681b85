#include "candidates/vote.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>

namespace nadir {
namespace {

std::int64_t day_of(const CandidateSidecar& sidecar) { return sidecar.captured_at.unix_ms / kDay_ms; }

bool newer(const Voter* a, const Voter* b) {
  if (a->sidecar.captured_at != b->sidecar.captured_at) return a->sidecar.captured_at > b->sidecar.captured_at;
  return a->tile < b->tile;
}

// The best tile of each flight, newest first.
std::vector<const Voter*> best_of_each_flight(const Ballot& ballot) {
  std::vector<const Voter*> flights;
  for (const Voter& voter : ballot.voters) {
    const auto same = std::find_if(flights.begin(), flights.end(), [&voter](const Voter* other) {
      return other->sidecar.airframe == voter.sidecar.airframe && other->sidecar.flight == voter.sidecar.flight;
    });
    if (same == flights.end()) {
      flights.push_back(&voter);
    } else if (cost_mm(voter.sidecar) < cost_mm((*same)->sidecar)) {
      *same = &voter;
    }
  }
  std::sort(flights.begin(), flights.end(), newer);
  return flights;
}

// The flights that have a voice, newest first. Seats are given in rounds: first to the newest flight of each airframe,
// then to the second newest of each, until all are taken. So a key that signs any number of flights takes one seat
// from the others, not all of them.
std::vector<const Voter*> seated_flights(const Ballot& ballot) {
  const std::vector<const Voter*> flights = best_of_each_flight(ballot);
  struct Seat {
    std::size_t round;
    const Voter* flight;
  };
  std::map<std::string_view, std::size_t> of_airframe;
  std::vector<Seat> seats;
  for (const Voter* flight : flights) seats.push_back({of_airframe[flight->sidecar.airframe]++, flight});
  std::stable_sort(seats.begin(), seats.end(), [](const Seat& a, const Seat& b) { return a.round < b.round; });
  if (seats.size() > kMaxIndependentFlights) seats.resize(kMaxIndependentFlights);
  std::vector<const Voter*> seated;
  for (const Seat& seat : seats) seated.push_back(seat.flight);
  std::sort(seated.begin(), seated.end(), newer);
  return seated;
}

// Votes that were taken before, and those that are taken now.
class Votes {
 public:
  Votes(const Ballot& ballot, const CompareImages& compare, std::vector<Vote>& taken)
      : known_(ballot.votes), compare_(compare), taken_(taken) {}

  const Vote& between(const Voter& a, const Voter& b) {
    const Voter &one = a.tile < b.tile ? a : b, &other = a.tile < b.tile ? b : a;
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

// The largest group of independent flights around one of them, each agreeing with each; that one is the newest. Not the
// first group that comes up: a flight that agrees with one honest flight alone must not keep a larger group apart.
class AgreeingGroup {
 public:
  AgreeingGroup(std::span<const Voter* const> flights, Votes& votes, const CandidateRules& rules)
      : flights_(flights), votes_(votes), rules_(rules) {}

  std::vector<const Voter*> around(std::size_t first) {
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
  bool fits(const Voter& flight) {
    return std::all_of(group_.begin(), group_.end(), [&](const Voter* member) {
      return independent(member->sidecar, flight.sidecar, rules_) && votes_.between(*member, flight).agrees;
    });
  }

  std::span<const Voter* const> flights_;
  Votes& votes_;
  const CandidateRules& rules_;
  std::vector<const Voter*> group_, largest_;
};

// The largest sigma among the needed number of most certain flights: a smaller one is claimed by its own flight alone.
std::int64_t corroborated_sigma_mm(std::span<const Voter* const> group, const CandidateRules& rules) {
  std::vector<std::int64_t> sigmas_mm;
  for (const Voter* voter : group) sigmas_mm.push_back(voter->sidecar.pose.sigma_mm);
  std::sort(sigmas_mm.begin(), sigmas_mm.end());
  return sigmas_mm[static_cast<std::size_t>(rules.flights_to_promote) - 1];
}

std::string evidence_of(const Voter& promoted, std::span<const Voter* const> group, Votes& votes,
                        const CandidateRules& rules) {
  nlohmann::json evidence{{"needed", rules.flights_to_promote},
                          {"sigma_mm", corroborated_sigma_mm(group, rules)},
                          {"flights", nlohmann::json::array()}};
  for (const Voter* voter : group) {
    nlohmann::json flight{{"airframe", voter->sidecar.airframe},
                          {"flight", voter->sidecar.flight},
                          {"base_package", voter->sidecar.base_package.hex()},
                          {"sha256", voter->sidecar.sha256.hex()},
                          {"captured_at", to_rfc3339(voter->sidecar.captured_at)}};
    if (voter != &promoted) {
      const Vote& vote = votes.between(promoted, *voter);
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
  // A flight over midnight that was begun anew in the air has another name and another day, and is one flight.
  const std::int64_t apart_ms = std::abs(one.captured_at.unix_ms - other.captured_at.unix_ms);
  return !rules.airframes_differ && one.flight != other.flight && day_of(one) != day_of(other) &&
         apart_ms >= rules.apart_ms;
}

std::int64_t allowed_shift_mm(double sigma_one_mm, double sigma_other_mm, const CandidateRules& rules) {
  return std::max(rules.floor_mm, static_cast<std::int64_t>(rules.sigmas * std::hypot(sigma_one_mm, sigma_other_mm)));
}

Outcome decide(const Ballot& ballot, const CompareImages& compare, std::int64_t now_ms, const CandidateRules& rules) {
  Outcome outcome;
  const std::vector<const Voter*> flights = seated_flights(ballot);
  Votes votes(ballot, compare, outcome.new_votes);
  AgreeingGroup groups(flights, votes, rules);
  for (std::size_t first = 0; first < flights.size(); ++first) {
    const std::vector<const Voter*> group = groups.around(first);
    if (std::ssize(group) < rules.flights_to_promote) continue;
    const Voter& best = **std::min_element(group.begin(), group.end(), [](const Voter* a, const Voter* b) {
      return cost_mm(a->sidecar) < cost_mm(b->sidecar);
    });
    if (ballot.promoted != best.tile) {
      outcome.promotion = {.tile = best.tile,
                           .key = ballot.key,
                           .decided_ms = now_ms,
                           .flights = std::ssize(group),
                           .evidence = evidence_of(best, group, votes, rules)};
    }
    break;
  }
  return outcome;
}

}  // namespace nadir
