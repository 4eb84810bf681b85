// Which tile of an address is promoted, and which flights corroborate it.
//
// A tile is promoted when enough independent flights show the same ground at the same place. Independent are flights of
// different airframes; where the rules allow it, also those of one airframe on different days and hours apart. One
// flight counts once, with its best tile, and airframes take turns for the seats of a vote: however many flights one
// key signs, the newest flight of every other airframe is heard. The newest tile that finds enough others that agree
// decides which ground is the true one: so a change on the ground wins as soon as enough flights have seen it. Of those
// that agree the best is promoted (cost_mm).
#pragma once

#include <functional>
#include <span>

#include "candidates/candidate_rules.hpp"
#include "candidates/catalogue_rows.hpp"

namespace nadir {

inline constexpr std::size_t kMaxIndependentFlights = 12;  // seats; bounds the work for one address

bool independent(const CandidateSidecar& one, const CandidateSidecar& other, const CandidateRules& rules);

// How far two tiles that are both where they claim to be may lie apart.
std::int64_t allowed_shift_mm(double sigma_one_mm, double sigma_other_mm, const CandidateRules& rules);

// compare: compares the two images; called only for pairs that the ballot has no vote on.
using CompareImages = std::function<Vote(const Voter& one, const Voter& other)>;
Outcome decide(const Ballot& ballot, const CompareImages& compare, std::int64_t now_ms, const CandidateRules& rules);

}  // namespace nadir
