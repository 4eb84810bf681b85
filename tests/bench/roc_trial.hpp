// One attempt to match a frame in a window that contains its place, or in one that does not: the knock-out test.
#pragma once

#include <cstdint>
#include <string>

#include "safety_camera.hpp"

namespace nadir::bench {

inline constexpr double kRight_m = 25;  // a match this close to the truth is correct

struct Trial {
  std::uint64_t index = 0;
  std::string window;   // right, elsewhere, mirrored, other
  std::string picture;  // clear, old, clouds, blur, night
  double radius_m = 0;
  double ratio = 1, score = -1;
  int inliers = 0, patches = 0;
  double frame_share = 0, residual_px = 0, surprise = 0;
  double error_m = -1;  // of the solved position; −1: none
  std::string verdict;  // of the gates, without a prediction to compare with

  bool holds_place() const { return window == "right"; }
  bool right() const { return holds_place() && error_m >= 0 && error_m <= kRight_m; }
  bool accepted() const { return verdict == "accepted"; }
  double inlier_share() const { return patches == 0 ? 0 : static_cast<double>(inliers) / patches; }
};

std::string trial_header(std::uint64_t base_seed, int worlds);
std::string line(const Trial& trial);
Trial trial_of(const std::string& line);

Trial try_match(const Worlds& worlds, const Photographer& photographer, std::uint64_t base_seed, std::uint64_t index);

}  // namespace nadir::bench
