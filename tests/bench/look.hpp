// One look: a frame matched in a window of a map that holds its place, or of one that does not (the knock-out test,
// where every acceptance is false by definition). What is known of the candidate, and whether it is right.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
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
  double fine_gsd_m = 0, coarse_gsd_m = 0;      // of the matching
  double rival_apart_m = 0, rival_error_m = 0;  // the second best place, from the candidate and the truth; 0: none
  // Of the position, from the truth, and processor time of the match. Stored where a plan names its matcher.
  Eigen::Vector2d off_m = Eigen::Vector2d::Zero();
  double cpu_ms = 0;
  bool names_matcher = false;
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
  // What is measured. Named: the results say so, and hold the position that was found.
  MapMatcherFactory matcher = make_channel_matcher;
  std::string matcher_name{};
};

std::string look_header(std::uint64_t base_seed, const LookPlan& plan, const Grounds& grounds,
                        std::uint64_t windows_of_picture = 1);
std::string line(const Look& look);
Look look_of(const std::string& line);

// Results that were kept with --resume. Throws UsageError for another file, Error for a line that cannot be read.
struct LooksFile {
  std::string run;  // of the header, without the grounds
  std::string grounds;
  bool shared_pictures = false;  // a LookTaker's
  Looks looks;
};
LooksFile read_looks(const std::filesystem::path& path);

// Everything follows from the base seed and the index.
Look take_look(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed, std::uint64_t index);

// The same at less cost: kWindowsOfPicture looks in a row are of one picture, each in a window of its own. They share
// what is odd about the picture, so that it is pictures that are independent, not looks. One object for each thread.
class LookTaker {
 public:
  static constexpr std::uint64_t kWindowsOfPicture = 8;
  LookTaker(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed);
  ~LookTaker();
  Look take(std::uint64_t index);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The index of the picture that a LookTaker's look was taken of.
inline std::uint64_t picture_of(std::uint64_t look) { return look / LookTaker::kWindowsOfPicture; }

// Two looks in a row, in the same kind of window of the same map.
struct LooksInARow {
  Look first, second;
  double new_ground = 1;  // share of the second picture that the first does not show; above 1: farther apart
};
LooksInARow take_looks_in_a_row(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed,
                                std::uint64_t index);

// What such a look was taken of, without taking it.
struct PlaceOfLook {
  const Ground& ground;
  PlanePoint middle{};  // of the ground in the picture
  double agl_m = 0;
};
PlaceOfLook place_of_look(const Grounds& grounds, const LookPlan& plan, std::uint64_t base_seed, std::uint64_t index);

}  // namespace nadir::bench
