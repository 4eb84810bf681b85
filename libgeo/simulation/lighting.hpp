// Puts a painting into the sun: relief, slopes of roofs and crowns, cast shadows, dim gaps; then a camera's eye.
#pragma once

#include "simulation/painter.hpp"

namespace nadir {

struct Sun {
  double azimuth_rad = 0;  // where it stands, clockwise from north
  double elevation_rad = 0;
};

// The painting as lit linear colours, in place. Shadows fall right where everything that casts them lies within the
// grid: paint a rim of shadow_reach_m() around what is kept.
void light_painting(Painting& painting, const PixelGrid& grid, const Relief& relief, const Sun& sun);
double shadow_reach_m(const Sun& sun);

}  // namespace nadir
