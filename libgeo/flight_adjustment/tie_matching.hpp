// The same ground in two pictures.
//
// The poses are known roughly, so a feature of one picture is looked for in the other one where its ground should
// appear. How far around depends on what is unknown of the two poses against each other. Of the candidates there the
// one with the nearest descriptor counts, if nothing else in the wider surroundings looks nearly as much alike (the
// ratio test; Lowe 2004): in rows of crops the second one looks the same.
//
// Then all matches of a pair must agree on one homography (MAGSAC++; Barath and others 2020), which is how two pictures
// of a plane are related. Ground that is not a plane is shifted by its parallax, so the bound grows with
//   f B σ_relief / h²   [pixels]      B: distance between the cameras, h: height above ground.
// An essential matrix would allow all relief, but is undetermined where the ground is level, as it usually is.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "flight_adjustment/tie_features.hpp"
#include "vision/feature_matching.hpp"
#include "vision/ground_surface.hpp"
#include "vision/rectification.hpp"

namespace nadir {

// A picture with the pose that is expected of it.
struct TieView {
  TieFeatures features;
  CameraPose pose;
  std::vector<cv::Point2f> straight;              // the features' pixels without the lens' distortion
  std::vector<std::optional<PlanePoint>> ground;  // where their rays meet the ground; nothing near the horizon
};

// camera: tie_camera().
TieView tie_view(TieFeatures features, const CameraModel& camera, const CameraPose& pose, const GroundSurface& ground);

// Of `first`'s features in `second`, within reach_px of where they are expected; each feature at most once.
std::vector<FeatureMatch> match_ties(const TieView& first, const TieView& second, const CameraModel& camera,
                                     const GroundSurface& ground, double reach_px);

// Those of them that agree on one homography; none when too few do.
std::vector<FeatureMatch> agreeing_ties(const TieView& first, const TieView& second, const CameraModel& camera,
                                        double relief_sigma_m, const std::vector<FeatureMatch>& matches);

}  // namespace nadir
