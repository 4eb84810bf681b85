// Which tile of an address is promoted, and which flights corroborate it.
//
// A tile is promoted when enough independent flights show the same ground at the same place. Independent are flights of
// different airframes; where the rules allow it, also those of one airframe on different days and hours apart. One
// flight counts once, with its best tile. The flights compared are chosen round-robin over the airframes, so that one
// key, however many flights it signs, cannot exclude the newest flight of another airframe. The newest tile that agrees
// with enough others decides what the ground looks like: a change on the ground is adopted as soon as enough flights
// have seen it. The best tile (cost_mm) of the agreeing group is promoted, and anew when the group has changed: its
// accuracy is that of all who corroborate it, in whichever order they came.
#pragma once

#include <functional>
#include <span>

#include "candidates/candidate_rules.hpp"
#include "candidates/catalogue_rows.hpp"

namespace nadir {

inline constexpr std::size_t kMaxIndependentFlights = 12;  // compared; bounds the work for one address

bool independent(const CandidateSidecar& one, const CandidateSidecar& other, const CandidateRules& rules);

// The largest offset between two tiles that are both where they claim to be.
std::int64_t allowed_shift_mm(double sigma_one_mm, double sigma_other_mm, const CandidateRules& rules);

// compare: compares the two images; called only for pairs that have no stored vote.
using CompareImages = std::function<Vote(const AcceptedCandidate& one, const AcceptedCandidate& other)>;
Outcome decide(const AddressCandidates& address, const CompareImages& compare, std::int64_t now_ms,
               const CandidateRules& rules);

}  // namespace nadir
