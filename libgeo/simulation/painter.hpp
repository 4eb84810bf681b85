// Paints a piece of a landscape: colour of every pixel in even light, and the height of what stands on the ground.
#pragma once

#include <algorithm>
#include <cmath>

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
  std::vector<GroundPoint> rows_;       // per parcel: unit vector along its rows
};

// The painter's working state for one piece, and the few strokes that all motifs share.

struct Painter::Canvas {
  PixelGrid grid;
  Painting painting;
  cv::Mat_<float> patches;  // noise of 8–30 m
  cv::Mat_<float> fine;     // noise of 1–3 m
  cv::Mat_<float> road;     // cover of the fields' own roads, painted above water

  void mix(int row, int column, const Light& light, double alpha) {
    cv::Vec3f& pixel = painting.colour(row, column);
    for (int i = 0; i < 3; ++i) {
      pixel[i] += static_cast<float>(alpha) * (static_cast<float>(light[i]) - pixel[i]);
    }
  }
};

inline double smooth_step(double low, double high, double value) {
  const double t = std::clamp((value - low) / (high - low), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

// Share of a pixel that lies inside an edge at signed distance `edge_m` (negative inside).
inline double cover_of(double edge_m, double gsd_m) { return std::clamp(0.5 - edge_m / gsd_m, 0.0, 1.0); }

// The pixels of the grid within `reach_m` of a place.
struct PixelBox {
  int first_column, last_column, first_row, last_row;

  PixelBox(const PixelGrid& grid, GroundPoint low, GroundPoint high)
      : first_column(std::max(0, static_cast<int>(std::floor(grid.column_of(low.x))))),
        last_column(std::min(grid.columns - 1, static_cast<int>(std::ceil(grid.column_of(high.x))))),
        first_row(std::max(0, static_cast<int>(std::floor(grid.row_of(high.y))))),
        last_row(std::min(grid.rows - 1, static_cast<int>(std::ceil(grid.row_of(low.y))))) {}
  PixelBox(const PixelGrid& grid, GroundPoint centre, double reach_m)
      : PixelBox(grid, centre - GroundPoint(reach_m, reach_m), centre + GroundPoint(reach_m, reach_m)) {}
  bool empty() const { return first_column > last_column || first_row > last_row; }
};

}  // namespace nadir
