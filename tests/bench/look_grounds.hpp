// The ground that looks are taken of, and the maps that they are matched with: painted worlds, and real imagery of two
// dates where the data folder is there. Every ground lies in the plane of frame() with its middle at (0, 0).
#pragma once

#include <deque>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "safety_camera.hpp"
#include "safety_world.hpp"

namespace nadir::bench {

// Training and judging share no seed, no world, no pair of pictures and no flight. Base seeds below 1000 train, those
// from a million on judge; others are an error.
enum class Purpose { train, judge };
Purpose purpose_of(std::uint64_t base_seed);
std::uint64_t first_world(Purpose purpose);  // the first painted world's seed

// A real frame with its telemetry and where it was taken.
struct RecordedFrame {
  std::filesystem::path file;
  double agl_m = 0, heading_rad = 0;  // measured
  PlanePoint truth;
};

struct Ground {
  std::string name;    // "painted 3", "naip 2009 2015": what the camera sees, then the map
  std::string region;  // grounds of one region show the same place
  cv::Mat picture;     // what the camera sees, BGR; empty for recorded frames
  cv::Mat seen;        // 255 where the picture shows ground; empty: everywhere
  double picture_gsd_m = 0;
  const GroundSurface* surface = nullptr;
  cv::Mat map_image;
  double map_gsd_m = 0;
  const TileSource *map = nullptr, *mirrored = nullptr, *turned = nullptr;
  const TileSource* old = nullptr;   // half of it has changed; painted worlds only
  double width_m = 0, height_m = 0;  // of the map
  double least_agl_m = 80, largest_agl_m = 400;
  double unit = 1;          // of distances: of windows, and around places
  double tolerance_m = 25;  // up to which a place is the true one
  CameraFile camera;
  std::vector<RecordedFrame> frames;
  bool truth_is_picture_centre = false;  // of recorded frames: the ground in the picture's centre, not the camera
  std::vector<std::size_t> others;       // grounds of other regions at a similar scale

  std::vector<std::unique_ptr<TileSource>> owned;
};

class Grounds {
 public:
  // data: the folder of the real sets; what is not there is left out. first_world: the painted worlds' first seed.
  Grounds(Purpose purpose, int worlds, std::uint64_t first_world, const std::filesystem::path& data);

  const std::deque<Ground>& painted() const { return painted_; }
  const std::deque<Ground>& real() const { return real_; }
  // Painted ones first, as Ground::others counts.
  const Ground& at(std::size_t i) const { return i < painted_.size() ? painted_[i] : real_[i - painted_.size()]; }
  std::string names() const;

 private:
  void add_painted();
  void add_naip(Purpose purpose, const std::filesystem::path& folder);
  void add_pairs(Purpose purpose, const std::filesystem::path& folder);
  void add_arroio(const std::filesystem::path& folder);
  void add_fengyuan(const std::filesystem::path& folder);
  void find_others();

  Worlds worlds_;
  FlatGround flat_;
  std::uint64_t first_world_;
  std::deque<Ground> painted_, real_;  // their maps point to their images
};

// $NADIR_DATA, or ../shared/data beside the checkout where that is; empty where neither is.
std::filesystem::path data_folder();

}  // namespace nadir::bench
