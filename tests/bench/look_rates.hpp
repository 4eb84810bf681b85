// How the likelihood ratio of a look holds on looks that it was not fitted to: how often chance peaks exceed a ratio,
// and whether a ratio is as much evidence as it says.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "counted_share.hpp"
#include "look.hpp"

namespace nadir::bench {

using LookFilter = std::function<bool(const Look&)>;
bool knocked_out(const Look& look);    // its window does not hold the place
std::string family(const Look& look);  // "painted", "naip", "pair", "arroio", "arroio flight", …

// Of those looks, with a likelihood ratio above t. Looks without a candidate count among all.
CountedShare share_above(const Looks& looks, double ratio, const LookFilter& filter);
// The thresholds t that tables show.
inline constexpr std::array<double, 5> kThresholds = {10, 100, 1000, 3000, 10000};

// Looks of one picture are not independent (LookTaker), pictures are: those with such a look among those with a look
// that cannot be right.
CountedShare pictures_above(const Looks& looks, double ratio);
std::string picture_table(const Looks& looks);

// Whether the looks contradict P(ratio > t | chance) <= 1 / t for one of the thresholds: the lower bound is above.
// One line for each, empty where none does.
std::string contradictions(const Looks& looks);

std::string rate_tables(const Looks& looks);
// Two drawings: observed against stated weight of evidence; and the share of chance peaks above each ratio, by family.
std::string reliability_svg(const Looks& looks);

}  // namespace nadir::bench
