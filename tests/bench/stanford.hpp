// The Stanford diagram: protection levels against errors (docs/integrity.md says how to read one), and what is counted
// in it.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "counted_share.hpp"

namespace nadir::bench {

inline constexpr double kAlertLimit_m = 100, kGoodLevel_m = 30;

// Of one published position that has a level.
struct LeveledError {
  double error_m = 0, hpl_m = 0;
};

// "3.2/21.5 4.0/22.1": for a cell of CSV; empty for none. Throws Error for anything else.
std::string levels_text(const std::vector<LeveledError>& levels);
std::vector<LeveledError> levels_of(const std::string& text);

struct LevelFigures {
  int positions = 0;                                     // with a level or without
  CountedShare below_30, usable, misleading, hazardous;  // of all positions; usable: within the alert limit
  double ratio_95 = 0, least_ratio = 0;                  // level over error, of usable positions
};
LevelFigures level_figures(int positions, const std::vector<LeveledError>& levels);

std::string level_table_head();
std::string level_row(std::string_view name, const LevelFigures& figures);
std::string stanford_svg(std::string_view title, const std::vector<LeveledError>& levels);

}  // namespace nadir::bench
