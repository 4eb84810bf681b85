// Looks as tables and curves: what a threshold accepts of correct and of wrong matches.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "look.hpp"

namespace nadir::bench {

struct Measure {
  std::string name;
  std::function<double(const Look&)> value;  // more is better
  std::vector<double> thresholds;            // for the table
  double sign = 1;                           // −1: shown reversed, less is better
};
const std::vector<Measure>& measures();

struct Shares {
  double right = 0;  // accepted and right, of the windows that hold the place
  double wrong = 0;  // accepted, of the windows that do not; plus accepted far from the place in those that do
  int right_count = 0, wrong_count = 0;
};
Shares shares_if(const Looks& looks, const std::function<bool(const Look&)>& accepts);

std::string tables(const Looks& looks);
std::string roc_svg(const Looks& looks);

}  // namespace nadir::bench
