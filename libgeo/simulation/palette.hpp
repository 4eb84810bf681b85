// Colours by season of crops, soils, roofs and trees, as seen from above in clear light.
//
// Chosen as sRGB bytes of sunlit flat ground, stored as linear light (BGR order, as all images here).
#pragma once

#include <opencv2/core/matx.hpp>

#include "simulation/landscape.hpp"

namespace nadir {

enum class Season { may, september };  // of the satellite image; of the flight

using Light = cv::Vec3d;  // linear, blue green red

Light light_from_srgb(int red, int green, int blue);
std::uint8_t srgb_from_light(double light);  // clips

struct CropAppearance {
  Light colour;
  Light second;          // between rows, in bare spots, after half the work is done
  double rows = 0;       // contrast of the rows
  double row_m = 3;      // their spacing
  double passes = 0;     // contrast between neighbouring passes of the machine
  double mottle = 0;     // how much the soil shows through
  double tramlines = 0;  // strength of the tractor's tracks
  double grain = 0.05;   // fine texture
};

CropAppearance appearance_of(const Parcel& parcel, Season season);

Light roof_colour(Roof roof);
Light cover_colour(Cover cover, Season season);
Light tree_colour(const Tree& tree, Season season);

}  // namespace nadir
