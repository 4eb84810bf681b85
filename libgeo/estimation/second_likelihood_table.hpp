// Made by `./run bench matchers --write`; never edited by hand. second_opinion.hpp says what the numbers mean.
// clang-format off
#pragma once

#include "estimation/second_opinion.hpp"

namespace nadir {

inline constexpr SecondLikelihoodTable kSecondLikelihoodTable{};

}  // namespace nadir
