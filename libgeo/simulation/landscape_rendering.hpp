// A landscape as an image: painted, lit by the sun, and seen by a sensor; as the camera finds it on the day of the
// flight, or as a satellite saw it months earlier: another season, another sun, a blurred and noisy sensor with haze
// and a colour cast, and slightly misplaced.
#pragma once

#include "simulation/painter.hpp"

namespace nadir {

struct Sun {
  double azimuth_rad = 0;  // clockwise from north
  double elevation_rad = 0;
};

// Lights the painting in place: relief, slopes of roofs and crowns, cast shadows, ambient occlusion. Shadows are right
// where everything that casts them lies within the grid: paint a margin of shadow_reach_m() around what is kept.
void light_painting(Painting& painting, const PixelGrid& grid, const Relief& relief, const Sun& sun);
double shadow_reach_m(const Sun& sun);

enum class View { day, satellite };

// The misplacement of the satellite's map: what lies at `position` appears at position + bias. Smooth, 0.5 to 2 m.
GroundPoint map_bias_m(std::uint64_t seed, GroundPoint position);

Sun sun_of(View view);

// One piece of the image, 8 bit BGR.
cv::Mat_<cv::Vec3b> render_view(const Landscape& land, const Painter& painter, View view, const PixelGrid& grid);

}  // namespace nadir
