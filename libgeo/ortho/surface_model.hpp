// The shape of the ground that a flight saw (a digital surface model), from its own frames, so that the parts of an
// orthophoto fit where they meet.
//
// An orthophoto is as good as the heights it is made with. A point δ above the modelled ground, seen by a camera whose
// line of sight leans by s = (X - C) / (C_up - X_up) (metres aside for a metre down), is shown δ s away from its place.
// Frames a and b show it displaced against each other by
//
//   d = δ (s_b - s_a)                                       hence   δ = d · (s_b - s_a) / |s_b - s_a|²
//
// with σ_δ = σ_d / |s_b - s_a|. What of d is across that direction is no height: noise, a car, an error of the poses.
// So heights are what makes the orthophotos of two frames agree: both are made over the heights that are known so far,
// parts of them are registered, and the heights corrected; first with coarse pixels, where parts are far displaced but
// still found, then with finer ones. (Norvelle, "Using iterative orthophoto refinements to generate and correct digital
// elevation models", Digital Photogrammetry: An Addendum to the Manual of Photogrammetry, ASPRS 1996.)
//
// Each round gives corrections in square cells, the median of what all pairs of frames say, and a model is their sum
// over the terrain below: cells that no pair measured keep what the coarser rounds say. Walls are as steep as a cell is
// wide; what moves, and water, gets no height of its own.
//
// The heights belong to the poses that they were made with: an error of those bends the model. It is made to look at,
// not to measure by.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "base/progress.hpp"
#include "vision/rectification.hpp"

namespace nadir {

class SurfaceModel final : public GroundSurface {
 public:
  // terrain: must outlive this.
  explicit SurfaceModel(const GroundSurface& terrain) : terrain_(&terrain) {}

  double height_m(PlanePoint point) const override;
  double relief_sigma_m() const override { return terrain_->relief_sigma_m(); }

  // A pose that states its height over the terrain, stating it over this surface: the camera stays where it is.
  CameraPose over_surface(const CameraPose& over_terrain) const;

  struct Correction {
    std::int32_t column = 0, row = 0;  // of the cell whose middle is at (column, row) times cell_m, east and north
    double height_m = 0;
  };
  void add(double cell_m, std::span<const Correction> corrections);

 private:
  struct Round {
    double cell_m = 1;
    std::unordered_map<std::uint64_t, float> heights_m;  // by cell
  };

  const GroundSurface* terrain_;
  std::vector<Round> rounds_;
};

// What a model was made of, and what the round before the last had left: displacements of the same ground in two
// frames, medians of their parts along the direction in which heights displace, and across it.
struct SurfaceModelFigures {
  std::size_t pairs = 0, measured = 0;  // of frames; parts of the ground, in all pairs
  double pixel_m = 0, along_px = 0, across_px = 0;
};

using PictureOf = std::function<cv::Mat(std::size_t frame)>;  // CV_8UC1, of the camera's size; empty: none

// poses: over `terrain`, one per frame, nothing where a frame is not to be used. A frame keeps up to 400 kB meanwhile.
// The same input gives the same bits. Throws Interrupted, and what picture_of throws.
SurfaceModel surface_from_frames(const CameraModel& camera, const GroundSurface& terrain,
                                 std::span<const std::optional<CameraPose>> poses, const PictureOf& picture_of,
                                 Progress& progress, SurfaceModelFigures* figures = nullptr);

}  // namespace nadir
