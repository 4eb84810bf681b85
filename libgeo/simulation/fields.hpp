// How land is divided: recursive cuts of a warped plane, and what is grown on the pieces.
#pragma once

#include "base/random.hpp"
#include "simulation/landscape.hpp"

namespace nadir {

// A piece of a cut that bounds parcels, as a line on the ground.
struct BorderLine {
  Border border = Border::furrow;
  std::vector<Spot> points;
};

struct DividedLand {
  FieldPattern pattern;
  std::vector<BorderLine> borders;
};

DividedLand divide_land(const Random& random, double size_m);

// Chooses the crops; needs the river, the ponds and the village to be where they are.
void plant_crops(const Random& random, Landscape& land);

}  // namespace nadir
