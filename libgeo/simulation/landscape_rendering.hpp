// A landscape as the camera finds it on the day, and as a satellite saw it months earlier: another season, another sun,
// a blurred and noisy sensor with haze and a colour cast, and placed a little wrong.
#pragma once

#include "simulation/painter.hpp"

namespace nadir {

enum class View { day, satellite };

// How far the satellite's map is out of place: what lies at `spot` appears at spot + bias. Smooth, 0.5 to 2 m.
GroundPoint map_bias_m(std::uint64_t seed, GroundPoint position);

Sun sun_of(View view);

// One piece of the picture, 8 bit BGR.
cv::Mat_<cv::Vec3b> render_view(const Landscape& land, const Painter& painter, View view, const PixelGrid& grid);

// Puts a painting into the sun: relief, slopes of roofs and crowns, cast shadows, dim gaps; then a camera's eye.

struct Sun {
  double azimuth_rad = 0;  // where it stands, clockwise from north
  double elevation_rad = 0;
};

// The painting as lit linear colours, in place. Shadows fall right where everything that casts them lies within the
// grid: paint a rim of shadow_reach_m() around what is kept.
void light_painting(Painting& painting, const PixelGrid& grid, const Relief& relief, const Sun& sun);
double shadow_reach_m(const Sun& sun);

}  // namespace nadir
