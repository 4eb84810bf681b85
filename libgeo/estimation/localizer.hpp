// The localizer: frames and telemetry in, estimates out. The same object flies in nadird, replays flights and stands
// behind the API; it reads no clock and no files but the map's tiles.
//
// The path of one frame is Localizer::process(), which reads like the walk in docs/concepts.md. Looking at the map
// takes longer than a frame may wait in flight: follow() and finish() are the same walk in two parts, and what lies
// between them may run elsewhere while other frames are followed.
#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "estimation/anchor_gates.hpp"
#include "estimation/estimate.hpp"
#include "estimation/odometry.hpp"
#include "estimation/telemetry.hpp"
#include "geodesy/local_frame.hpp"
#include "imagery/tile_source.hpp"
#include "vision/camera.hpp"
#include "vision/ground_surface.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

struct LocalizerConfig {
  GateLimits gates;
  double start_sigma_m = 50;  // of the start position, one axis
  // The start is what this flight knew before its program was restarted. The map has agreed with the flight before, so
  // that frames which agree with each other overrule such a start; one told by others they do not, for maps may lie.
  bool resumed = false;
  double min_search_radius_m = 60;  // half side of the searched square
  double max_search_radius_m = 1200;
  double no_fix_sigma_m = 500;  // beyond this no position is told
  double map_sigma_m = 2.8;     // one axis of the map's own error, see map_sigma_from_ce90()
  double assumed_agl_m = 120;   // only when telemetry never tells the height
  // A healthy flight need not look at the map for every frame: after so much way, or when less sure than this (one
  // axis). 0 m: every frame.
  double anchor_every_m = 0;
  double anchor_above_sigma_m = 5;
  std::optional<PlaneBox> area;            // where the flight can be at all: searched when the start is not known
  const GroundSurface* surface = nullptr;  // terrain; null: flat ground. Must outlive the localizer.
  // Names places that look alike (a package's place index), so that one who is lost need not search all of the area at
  // once; null: it does. Must outlive the localizer.
  const PlaceRetrieval* places = nullptr;
  OdometryFactory odometry = make_feature_odometry;
  MapMatcherFactory matcher = make_channel_matcher;
};

// One axis' sigma of a circular error given as CE90.
double map_sigma_from_ce90(double ce90_m);

class AnchorJob;

class Localizer {
 public:
  // frame: the plane in which everything is estimated; with a map the one of its mission. tiles: the map, or null for
  // odometry alone; it must outlive the localizer. start: where the flight begins, if known.
  Localizer(const CameraFile& camera, const LocalFrame& frame, const TileSource* tiles, std::optional<LonLat> start,
            const LocalizerConfig& config = {});
  ~Localizer();

  // image: CV_8UC1 or CV_8UC3 of the camera's size; empty when the frame could not be decoded.
  FrameReport process(const cv::Mat& image, const Telemetry& told);

  // The frame without the map. `job`: to be run and handed to finish(); none when there is nothing to look for, or
  // while another one is out.
  struct Followed {
    FrameReport report;
    std::unique_ptr<AnchorJob> job;
  };
  Followed follow(const cv::Mat& image, const Telemetry& told);
  // What the map said of the job's frame, however many were followed since. The anchor report is of that frame, the
  // estimate of the last one followed: it has been thought over from the job's frame on.
  FrameReport finish(std::unique_ptr<AnchorJob> job);

  // An operator says where the aircraft is, within radius_m. Looked at first while no healthy prediction is there, and
  // forgotten with the next anchor. It moves no position: one that it contradicts, and that no anchor has confirmed
  // without a break, is doubted by as much as the two lie apart. Throws UsageError for what is no place or no radius.
  void hint(const LonLat& at, double radius_m);

  // All frames so far after smoothing with all anchors: same order, same fields.
  std::vector<Estimate> refined() const;
  // The camera's poses of the same frames, after smoothing: of those whose own anchor was accepted and contradicts no
  // other.
  std::vector<std::optional<FramePose>> refined_poses() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace nadir
