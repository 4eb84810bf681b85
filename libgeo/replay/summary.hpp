// The figures of a replay: summary.json, and the table on the terminal and in the report.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>

#include "cli/output.hpp"
#include "replay/score.hpp"

namespace nadir {

struct Summary {
  Score streamed;
  Score refined;
  double peak_memory_mb = 0;  // of this process, 10^6 bytes
};

nlohmann::json json_from(const Summary& summary);
Figures figures_from(const Summary& summary);

double peak_memory_mb();

}  // namespace nadir
