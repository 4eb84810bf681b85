// One look: a frame matched in a window of a map that holds its place, or of one that does not (the knock-out test,
// where every acceptance is false by definition). What is known of the candidate, and whether it is right.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "estimation/look_likelihood.hpp"
#include "look_grounds.hpp"

namespace nadir::bench {

struct Look {
  std::uint64_t index = 0;
  std::string ground;   // Ground::name
  std::string window;   // right, elsewhere, mirrored, turned, other
  std::string picture;  // clear, old, clouds, blur, night
  double radius_m = 0, agl_m = 0;
  int patches = 0;
  LookFeatures features;  // ratio and score also where there is no candidate
  double error_m = -1;    // of the ground in the picture's centre; -1: no candidate
  double camera_error_m = -1;
  double camera_sigma_m = 0;  // of the solved position, with what the solver does not model; the larger axis
  double tolerance_m = 25;
  std::string verdict;  // no_map, no_pose, candidate

  bool candidate() const { return error_m >= 0; }
  // The same ground, and the camera no farther off than tilt and height leave open. The patches reach beyond the
  // searched square and sometimes find the place from just outside.
  bool right() const {
    return (window == "right" || window == "elsewhere") && candidate() && error_m <= tolerance_m &&
           camera_error_m <= tolerance_m + 3 * camera_sigma_m;
  }
  bool holds_place() const { return window == "right" || right(); }
  bool accepted() const { return candidate() && log_likelihood_ratio(features) >= parameters::belief::kUnambiguous; }
};

using Looks = std::map<std::uint64_t, Look>;

// What to draw looks from.
struct LookPlan {
  double real_share = 0.5;   // of looks over real imagery, where there is any
  double right_share = 0.4;  // of windows that hold the place
};

std::string look_header(std::uint64_t base_seed, const LookPlan& plan, const Grounds& grounds);
std::string line(const Look& look);
Look look_of(const std::string& line);

// Everything follows from the base seed and the index.
Look take_look(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed, std::uint64_t index);

// What such a look was taken of, without taking it.
struct PlaceOfLook {
  const Ground& ground;
  PlanePoint middle{};  // of the ground in the picture
  double agl_m = 0;
};
PlaceOfLook place_of_look(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed, std::uint64_t index);

}  // namespace nadir::bench
