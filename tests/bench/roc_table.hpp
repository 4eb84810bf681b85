// Trials as tables and curves: what a threshold accepts of correct and of wrong matches.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "roc_trial.hpp"

namespace nadir::bench {

using Trials = std::map<std::uint64_t, Trial>;

struct Measure {
  std::string name;
  std::function<double(const Trial&)> value;  // more is better
  std::vector<double> thresholds;             // for the table
  double sign = 1;                            // −1: shown reversed, less is better
};
const std::vector<Measure>& measures();

struct Shares {
  double right = 0;  // accepted and right, of the windows that hold the place
  double wrong = 0;  // accepted, of the windows that do not; plus accepted far from the place in those that do
  int right_count = 0, wrong_count = 0;
};
Shares shares_if(const Trials& trials, const std::function<bool(const Trial&)>& accepts);

std::string tables(const Trials& trials);
std::string roc_svg(const Trials& trials);

}  // namespace nadir::bench
