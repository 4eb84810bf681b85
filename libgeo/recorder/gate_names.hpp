// The gates' thresholds by name, for the session record.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "estimation/anchor_acceptance.hpp"

namespace nadir {

std::vector<std::pair<std::string, double>> named_gates(const GateLimits& gates);
void set_gate(GateLimits& gates, std::string_view name, double value);  // names that are not known change nothing

}  // namespace nadir
