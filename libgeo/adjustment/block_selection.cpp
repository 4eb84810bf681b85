#include "adjustment/block_selection.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "base/disjoint_sets.hpp"

namespace nadir {
namespace {

namespace table = parameters::adjustment;

}  // namespace

BlockSelection::BlockSelection(const BlockData& data, BlockState& state, FrameWindow window)
    : data_(data),
      state_(state),
      free_(data.frames.size(), false),
      kept_(data.anchors.size(), true),
      uses_(data.points.size()),
      used_(data.points.size(), false),
      counts_(data.frames.size(), 0),
      part_(data.frames.size()),
      anchored_(data.frames.size(), false),
      held_(data.frames.size(), false) {
  for (std::size_t j = 0; j < uses_.size(); ++j) {
    uses_[j].assign(data.points[j].observations.size(), ObservationUse::outside_window);
  }
  std::fill(free_.begin() + static_cast<std::ptrdiff_t>(window.begin),
            free_.begin() + static_cast<std::ptrdiff_t>(window.end), true);
  std::iota(part_.begin(), part_.end(), 0U);
}

bool BlockSelection::any_free() const { return std::find(free_.begin(), free_.end(), true) != free_.end(); }

// Where points start: where the rays of their observations meet the ground, on average.
void BlockSelection::place_points() {
  CameraModel camera = data_.camera;
  camera.fx *= std::exp(state_.calibration.log_focal);
  camera.fy *= std::exp(state_.calibration.log_focal);
  camera.distortion = state_.calibration.distortion;
  std::vector<std::optional<CameraPose>> poses(data_.frames.size());
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    const TiePoint& point = data_.points[j];
    auto& uses = uses_[j];
    const bool seen = std::any_of(point.observations.begin(), point.observations.end(),
                                  [&](const ImageObservation& o) { return free_[o.frame]; });
    if (!seen) continue;
    if (!state_.point_known[j]) {
      Eigen::Vector2d sum = Eigen::Vector2d::Zero();
      double hits = 0;
      for (const ImageObservation& o : point.observations) {
        auto& pose = poses[o.frame];
        if (!pose) pose = state_.frames[o.frame].pose(data_.ground);
        const auto hit = ground_from_ray(*pose, camera.ray_from_pixel(o.pixel), data_.ground);
        if (!hit || !hit->vector().allFinite()) continue;
        sum += hit->vector();
        ++hits;
      }
      if (hits > 0) {
        const PlanePoint place(sum / hits);
        state_.points[j] = {place.east_m, place.north_m, data_.ground.height_m(place)};
        state_.point_known[j] = true;
      } else if (point.control) {
        const PlanePoint place = point.control->place;
        state_.points[j] = {place.east_m, place.north_m, data_.ground.height_m(place)};
        state_.point_known[j] = true;
      }
    }
    std::size_t usable = 0;
    for (std::size_t k = 0; k < uses.size(); ++k) {
      const FrameBlock& frame = state_.frames[point.observations[k].frame];
      const bool visible =
          state_.point_known[j] && project(data_.lens, state_.calibration, frame, state_.points[j]).has_value();
      uses[k] = visible ? ObservationUse::used : ObservationUse::behind_camera;
      usable += visible ? 1 : 0;
    }
    used_[j] = usable >= (point.control ? 1 : table::kMinRays);
    if (used_[j]) continue;
    for (auto& use : uses) {
      if (use == ObservationUse::used) use = ObservationUse::too_few;
    }
  }
}

// Switches anchors and observations off or on by the present state; whether any changed.
bool BlockSelection::decide() {
  bool changed = false;
  for (std::size_t a = 0; a < kept_.size(); ++a) {
    if (!adjusted(a)) continue;
    const bool keep = anchor_chi2(data_.anchors[a]) <=
                      (data_.anchors[a].whole ? table::kPoseAnchorSwitchOff : table::kAnchorSwitchOff);
    changed |= keep != kept_[a];
    kept_[a] = keep;
  }
  for (std::size_t j = 0; j < used_.size(); ++j) {
    if (!used_[j]) continue;
    const TiePoint& point = data_.points[j];
    std::size_t good = 0;
    for (std::size_t k = 0; k < point.observations.size(); ++k) {
      const ImageObservation& o = point.observations[k];
      const auto pixel = project(data_.lens, state_.calibration, state_.frames[o.frame], state_.points[j]);
      ObservationUse use = ObservationUse::behind_camera;
      if (pixel) {
        const double chi2 = (*pixel - o.pixel).squaredNorm() / (o.sigma_px * o.sigma_px);
        use = chi2 <= table::kObservationReject ? ObservationUse::used : ObservationUse::outlier;
      }
      good += use == ObservationUse::used ? 1 : 0;
      changed |= use != uses_[j][k];
      uses_[j][k] = use;
    }
    if (good >= (point.control ? 1 : table::kMinRays)) continue;
    used_[j] = false;
    changed = true;
    for (auto& use : uses_[j]) {
      if (use == ObservationUse::used) use = ObservationUse::too_few;
    }
  }
  return changed;
}

double BlockSelection::anchor_chi2(const BlockAnchor& anchor) const {
  if (anchor.whole) {
    const auto off = pose_difference(data_.ground, state_.frames[anchor.frame], anchor.whole->pose);
    return off ? off->dot(anchor.whole->covariance.llt().solve(*off)) : std::numeric_limits<double>::infinity();
  }
  const Eigen::Vector2d off = state_.frames[anchor.frame].centre_m().head<2>() - anchor.position.vector();
  return off.dot(anchor.covariance_m2.llt().solve(off));
}

// Which frames belong together, and which of these blocks something ties to the map.
void BlockSelection::connect() {
  const std::size_t count = data_.frames.size();
  std::fill(counts_.begin(), counts_.end(), 0);
  DisjointSets<std::size_t> connections(count);
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    if (!used_[j]) continue;
    std::optional<std::size_t> first;
    for (std::size_t k = 0; k < uses_[j].size(); ++k) {
      if (uses_[j][k] != ObservationUse::used) continue;
      const std::size_t frame = data_.points[j].observations[k].frame;
      ++counts_[frame];
      if (first) connections.join(*first, frame);
      first = frame;
    }
  }
  for (std::size_t i = 1; i < count; ++i) {
    if (motion_between(i)) connections.join(i - 1, i);
  }
  for (std::size_t i = 0; i < count; ++i) part_[i] = connections.root(i);
  anchored_.assign(count, false);
  held_.assign(count, false);
  for (std::size_t a = 0; a < data_.anchors.size(); ++a) {
    if (kept_[a] && adjusted(a)) anchored_[part_[data_.anchors[a].frame]] = true;
  }
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    if (!used_[j] || !data_.points[j].control) continue;
    for (std::size_t k = 0; k < uses_[j].size(); ++k) {
      if (uses_[j][k] != ObservationUse::used) continue;
      anchored_[part_[data_.points[j].observations[k].frame]] = true;
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (free_[i]) continue;
    held_[part_[i]] = true;
    if (state_.frame_states[i] == FrameState::anchored) anchored_[part_[i]] = true;
  }
}

bool BlockSelection::motion_between(std::size_t i) const {
  return i > 0 && data_.frames[i].continues_flight && (free_[i] || free_[i - 1]) &&
         (counts_[i] < table::kWellTied || counts_[i - 1] < table::kWellTied);
}

}  // namespace nadir
