// What the localizer knows, and the steps of its walk. localizer.cpp walks; localizer_anchor.cpp looks at the map. A
// job that is out reads camera, frame, tiles and surface, which never change, and what it was given.
#pragma once

#include "estimation/anchor_votes.hpp"
#include "estimation/anchor_window.hpp"
#include "estimation/flight_filter.hpp"
#include "estimation/flight_log.hpp"
#include "estimation/localizer.hpp"
#include "estimation/odometry.hpp"
#include "estimation/operator_hint.hpp"
#include "estimation/start_contradictions.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {

struct Localizer::State {
  State(const CameraFile& camera_file, const LocalFrame& local_frame, const TileSource* map_tiles,
        std::optional<LonLat> known_start, const LocalizerConfig& localizer_config)
      : camera(camera_file.camera),
        uncertainty(camera_file.uncertainty),
        frame(local_frame),
        tiles(map_tiles),
        start(known_start),
        config(localizer_config),
        placed(known_start.has_value()),
        surface(config.surface != nullptr ? config.surface : &flat),
        odometry(config.odometry()),
        matcher(tiles != nullptr ? config.matcher({camera, *tiles, frame, *surface}) : nullptr),
        window(localizer_config),
        unbroken(known_start.has_value()) {}

  // The walk, in order.
  void begin_frame(const Telemetry& telemetry, double seconds);
  bool follow(const cv::Mat& grey, const Telemetry& telemetry, OdometryReport& report);
  void doubt_way(double step_m);
  void forget_picture_if_turned(double heading_before_rad);
  double speed_below_mps(double sigmas, double least_sigma_mps) const;
  bool continues(double seconds) const;
  bool leaps(double step_m) const;
  void break_track();
  std::pair<Eigen::Vector2d, double> start_position() const;
  AnchorPrior anchor_prior() const;
  bool lost() const { return window.lost(placed, flight->position_sigma_m()); }
  bool anchor_due() const;
  bool too_low_to_be_found() const;
  // Where one who is lost looks: chosen with the frame, searched by its job.
  struct LostSearch {
    PlaneBox area;
    std::optional<PlaneBox> hint;
    PlaneBox part;  // of the area, to be searched when suggestions fail
  };
  LostSearch lost_search();
  AnchorMatch match_lost(const cv::Mat& grey, const AnchorPrior& prior, const LostSearch& where);
  void heed_hint();
  std::unique_ptr<AnchorJob> anchor_job(const cv::Mat& grey, double time_s);
  AnchorReport judge(const AnchorJob& job);
  void confirm(AnchorReport& report, const std::optional<Eigen::Vector2d>& off_m, const AnchorJob& job);
  double shared_error_factor(const Eigen::Vector2d& position, double agl_m) const;
  double wrong_consensus_m2(const AnchorReport& report) const;
  void take_anchor(const AnchorJob& job, const AnchorReport& report);
  void follow_again(std::size_t from);
  Estimate tell(const Telemetry& telemetry, bool anchored, bool tracked);
  StateEstimate belief() const;

  Believed believed() const;
  CameraPose predicted_pose() const;
  FramePose anchored_pose(const AnchorJob& job) const;  // with the filter at the job's frame
  Eigen::Matrix2d shared_error_m2() const;
  double unmodelled_m2(double agl_m) const;  // one axis' variance of what no model has

  static constexpr double kUnmeasuredHeightSigma = 0.3;  // of its logarithm

  CameraModel camera;
  TelemetryUncertainty uncertainty;
  LocalFrame frame;
  const TileSource* tiles;
  std::optional<LonLat> start;
  LocalizerConfig config;
  bool placed;  // the start is known, or an anchor has been found since
  FlatGround flat;
  const GroundSurface* surface;

  std::optional<FlightFilter> flight;  // made with the first telemetry, which shows whether tilt is logged
  std::optional<FlightFilter> fresh;   // the same before the first frame
  std::vector<FlightStep> log;
  std::unique_ptr<OdometryFrontEnd> odometry;
  std::unique_ptr<MapMatcher> matcher;  // none without a map

  FrozenFrameDetector frozen;
  bool tilt_logged = false;             // the telemetry has pitch and roll, if not in each frame
  std::optional<FramePose> taken_pose;  // of the anchor taken last
  double measured_agl_m = 0;
  bool height_measured = false;    // in this frame; else the last one told, or a guess, stands for it
  bool height_steady = false;  // in this frame and in the one before
  Eigen::Vector2d measured_tilt_rad = Eigen::Vector2d::Zero();  // pitch, roll
  std::optional<double> last_time_s;
  std::optional<double> last_anchor_s;
  std::optional<Eigen::Vector2d> last_anchor_at;
  int last_anchor_inliers = 0;
  double last_anchor_ratio = 1;
  // What steps since have taught of earlier ones. Between anchors it is not told: a track that odometry carries has no
  // jumps but those of anchors, and refined() has it all.
  Eigen::Vector2d held_back_m = Eigen::Vector2d::Zero();
  bool other_way = false;  // pictures and telemetry contradicted each other over a turn, and no anchor has settled it …
  double other_way_m = 0;                                    // … since when it may have gone so far astray
  Eigen::Vector2d contradicted_m = Eigen::Vector2d::Zero();  // where the map says that the start was, against it
  StartContradictions against_start;
  AnchorVotes votes;
  AnchorWindow window;
  std::optional<OperatorHint> hinted;
  bool unbroken;  // odometry has tracked every frame since the last anchor or the start
  int segment = 0;
  std::vector<Estimate> told;
  Telemetry last_telemetry;  // of the frame followed last
  bool last_tracked = false;
  bool last_in_line = false;  // it was the first, or odometry carried it
  bool torn = false;          // this frame ends what odometry had carried, although it should show much of the same
  bool job_out = false;       // a frame is being matched with the map
  bool last_look_failed = false;
  bool broken_since_job = false;
};

}  // namespace nadir
