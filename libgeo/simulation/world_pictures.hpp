// A landscape as the camera finds it on the day, and as a satellite saw it months earlier: another season, another sun,
// a blurred and noisy sensor with haze and a colour cast, and placed a little wrong.
#pragma once

#include "simulation/lighting.hpp"

namespace nadir {

enum class View { day, satellite };

// How far the satellite's map is out of place: what lies at `spot` appears at spot + bias. Smooth, 0.5 to 2 m.
Spot map_bias_m(std::uint64_t seed, Spot spot);

Sun sun_of(View view);

// One piece of the picture, 8 bit BGR.
cv::Mat_<cv::Vec3b> render_view(const Landscape& land, const Painter& painter, View view, const PixelGrid& grid);

}  // namespace nadir
