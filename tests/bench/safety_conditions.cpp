#include "safety_conditions.hpp"

#include <array>

namespace nadir::bench {
namespace {

constexpr std::array kConditions = {
    // Together as often as nominal was before the others came: so each index has the fault that it had.
    Condition{"nominal", Fault::none, 0, 2},
    Condition{"water", Fault::water},
    Condition{"compass deviates 9 deg", Fault::deviation},
    Condition{"old map", Fault::old_map, 0, 2},
    Condition{"heading +8 deg", Fault::heading_bias},
    Condition{"height 15 % off", Fault::height_scale},
    Condition{"map 50 m off", Fault::map_shift, 50},
    Condition{"map 200 m off", Fault::map_shift, 200},
    Condition{"map 1000 m off", Fault::map_shift, 1000},
    Condition{"part 50 m off", Fault::map_part, 50},
    Condition{"part 200 m off", Fault::map_part, 200},
    Condition{"mirrored map", Fault::mirrored_map, 0, 2},
    Condition{"other region", Fault::other_region, 0, 2},
    Condition{"frozen picture", Fault::frozen},
    Condition{"repeated frame", Fault::repeated},
    Condition{"black", Fault::black, 0, 0.5},
    Condition{"clouds", Fault::clouds},
    Condition{"blur", Fault::blur},
    Condition{"night", Fault::night},
    Condition{"20 % blackout", Fault::blackout},
    Condition{"outlier 350 m off", Fault::outlier},
    Condition{"time jumps", Fault::time_jump},
    Condition{"NaN attitude", Fault::no_attitude},
};

}  // namespace

std::span<const Condition> conditions() { return kConditions; }

const Condition& draw_condition(Random& random) {
  double sum = 0;
  for (const Condition& condition : kConditions) sum += condition.weight;
  double left = random.uniform(0, sum);
  for (const Condition& condition : kConditions) {
    left -= condition.weight;
    if (left < 0) return condition;
  }
  return kConditions.front();
}

}  // namespace nadir::bench
