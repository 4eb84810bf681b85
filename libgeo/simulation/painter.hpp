// Paints a piece of a landscape: the colour of every pixel in even light, and the height of what stands on the ground.
#pragma once

#include "simulation/palette.hpp"

namespace nadir {

struct Painting {
  cv::Mat_<cv::Vec3f> colour;  // linear, blue green red
  cv::Mat_<float> height_m;    // above the ground: trees, roofs; 0 elsewhere
  cv::Mat_<float> gloss;       // 0…1: water, which takes no relief
};

class Painter {
 public:
  // The landscape must outlive the painter.
  Painter(const Landscape& land, Season season);

  Painting paint(const PixelGrid& grid) const;

 private:
  struct Canvas;
  void fields(Canvas& canvas) const;
  void water(Canvas& canvas) const;
  void plots(Canvas& canvas) const;
  void roads(Canvas& canvas) const;
  void buildings(Canvas& canvas) const;
  void trees(Canvas& canvas) const;

  const Landscape& land_;
  Season season_;
  std::vector<CropAppearance> appearances_;  // per parcel
  std::vector<GroundPoint> rows_;            // per parcel: unit vector along its rows
};

}  // namespace nadir
