#include "adjustment/adjustment_run.hpp"

#include <ceres/crs_matrix.h>
#include <ceres/iteration_callback.h>
#include <ceres/loss_function.h>
#include <ceres/manifold.h>
#include <ceres/normal_prior.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <exception>
#include <tuple>
#include <utility>

#include "adjustment/block_selection.hpp"
#include "adjustment/marginal_covariance.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

namespace table = parameters::adjustment;

class CancelCallback final : public ceres::IterationCallback {
 public:
  CancelCallback(Progress& progress, const Cancel& cancel) : progress_(progress), cancel_(cancel) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    try {
      if (summary.iteration > 0) progress_.advance();  // may throw as well
      cancel_.check();
    } catch (...) {  // must not pass through Ceres
      thrown_ = std::current_exception();
      return ceres::SOLVER_ABORT;
    }
    return ceres::SOLVER_CONTINUE;
  }
  void rethrow() const {
    if (thrown_) std::rethrow_exception(thrown_);
  }

 private:
  Progress& progress_;
  const Cancel& cancel_;
  std::exception_ptr thrown_;
};

// One adjustment, of a window or of everything.
class AdjustmentRun {
 public:
  AdjustmentRun(const BlockData& data, BlockState& state, FrameWindow window, Progress& progress, const Cancel& cancel)
      : data_(data),
        state_(state),
        whole_(window.begin == 0 && window.end == data.frames.size()),
        progress_(progress),
        cancel_(cancel),
        selection_(data, state, window) {}

  AdjustedBlock run();

 private:
  std::vector<double> terrain_sigmas() const;
  void build();
  void add_frame_terms();
  void add_calibration();
  void add_motion();
  void add_points();
  bool solve(int iterations, double tolerance, double trust_region);
  bool covariances();
  void add_held_covariances(MarginalCovariances& marginal);
  void report_calibration();
  AdjustedBlock report() const;

  void add_term(ceres::CostFunction* cost, ceres::LossFunction* loss, const std::vector<double*>& blocks) {
    frame_terms_.push_back(problem_->AddResidualBlock(cost, loss, blocks));
  }

  const BlockData& data_;
  BlockState& state_;
  bool whole_;
  Progress& progress_;
  const Cancel& cancel_;
  BlockSelection selection_;

  double anchor_bound_ = table::kAnchorBound, pose_bound_ = table::kPoseAnchorBound;
  double huber_width_ = table::kObservationHuber;
  std::unique_ptr<ceres::LossFunction> switchable_{switchable_loss(anchor_bound_)};
  std::unique_ptr<ceres::LossFunction> switchable_pose_{switchable_loss(pose_bound_)};
  std::unique_ptr<ceres::LossFunction> huber_{huber_loss(huber_width_)};
  std::array<double, 3> no_boresight_{};
  double no_scale_ = 0;
  std::unique_ptr<ceres::Problem> problem_;
  std::vector<ceres::ResidualBlockId> frame_terms_, point_terms_;

  AdjustmentOutcome outcome_ = AdjustmentOutcome::converged;
  int iterations_ = 0;
  bool settled_ = false;                                    // the graduated rounds are over
  std::vector<std::size_t> frame_indices_, point_indices_;  // of the covariances
  std::optional<MarginalCovariances> marginal_;
};

std::vector<double> AdjustmentRun::terrain_sigmas() const {
  std::vector<double> sigmas(data_.points.size(), data_.options.terrain_sigma_m);
  const double cell_m = data_.options.terrain_correlation_m;
  struct InCell {
    std::int64_t east, north;
    std::size_t point;
  };
  std::vector<InCell> cells;
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    if (!selection_.used(j)) continue;
    if (settled_) {
      const Eigen::Vector3d& at = state_.points[j];
      const double off_m = std::abs(at.z() - data_.ground.height_m({at.x(), at.y()}));
      if (off_m > table::kTerrainOutlier * data_.options.terrain_sigma_m) {
        sigmas[j] *= table::kTerrainOutlierWidening;
        continue;
      }
    }
    if (cell_m <= 0) continue;
    cells.push_back({std::llround(state_.points[j].x() / cell_m), std::llround(state_.points[j].y() / cell_m), j});
  }
  std::sort(cells.begin(), cells.end(), [](const InCell& a, const InCell& b) {
    return std::tie(a.east, a.north, a.point) < std::tie(b.east, b.north, b.point);
  });
  for (std::size_t begin = 0; begin < cells.size();) {
    std::size_t end = begin;
    while (end < cells.size() && cells[end].east == cells[begin].east && cells[end].north == cells[begin].north) ++end;
    for (std::size_t i = begin; i < end; ++i) sigmas[cells[i].point] *= std::sqrt(static_cast<double>(end - begin));
    begin = end;
  }
  return sigmas;
}

void AdjustmentRun::build() {
  selection_.connect();
  ceres::Problem::Options options;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_ = std::make_unique<ceres::Problem>(options);
  frame_terms_.clear();
  point_terms_.clear();
  add_calibration();
  add_frame_terms();
  add_motion();
  add_points();
  for (std::size_t i = 0; i < data_.frames.size(); ++i) {
    double* values = state_.frames[i].values.data();
    if (!selection_.free(i) && problem_->HasParameterBlock(values)) problem_->SetParameterBlockConstant(values);
  }
}

void AdjustmentRun::add_calibration() {
  const CalibrationPrior& prior = data_.options.calibration;
  CalibrationBlock& c = state_.calibration;
  problem_->AddParameterBlock(&c.log_focal, 1);
  problem_->AddParameterBlock(c.distortion.data(), 5);
  problem_->AddParameterBlock(c.boresight_rad.data(), 3);
  problem_->AddParameterBlock(&c.log_height_scale, 1);
  problem_->AddParameterBlock(no_boresight_.data(), 3);
  problem_->AddParameterBlock(&no_scale_, 1);
  problem_->SetParameterBlockConstant(no_boresight_.data());
  problem_->SetParameterBlockConstant(&no_scale_);
  const auto add = [&](double* values, const std::vector<double>& sigmas, const std::vector<double>& means) {
    const auto size = static_cast<Eigen::Index>(sigmas.size());
    Eigen::MatrixXd weights = Eigen::MatrixXd::Zero(size, size);
    std::vector<int> held;
    for (Eigen::Index i = 0; i < size; ++i) {
      const double sigma = sigmas[static_cast<std::size_t>(i)];
      if (sigma > 0) {
        weights(i, i) = 1 / sigma;
      } else {
        held.push_back(static_cast<int>(i));
      }
    }
    if (!whole_ || held.size() == sigmas.size()) {
      problem_->SetParameterBlockConstant(values);
      return;
    }
    if (!held.empty()) problem_->SetManifold(values, new ceres::SubsetManifold(static_cast<int>(size), held));
    add_term(new ceres::NormalPrior(weights, Eigen::Map<const Eigen::VectorXd>(means.data(), size)), nullptr, {values});
  };
  const auto& k = data_.camera.distortion;
  add(&c.log_focal, {prior.focal_relative}, {0});
  add(c.distortion.data(), {prior.radial, prior.radial, prior.tangential, prior.tangential, prior.radial},
      {k.begin(), k.end()});
  add(c.boresight_rad.data(), {prior.boresight_axis_rad(0), prior.boresight_axis_rad(1), prior.boresight_axis_rad(2)},
      {0, 0, 0});
  add(&c.log_height_scale, {prior.height_scale}, {0});
}

void AdjustmentRun::add_frame_terms() {
  std::vector<double> members(data_.frames.size(), 0);  // free frames of each part
  std::vector<bool> gauge_held = selection_.parts_with_held_frames();
  for (std::size_t i = 0; i < data_.frames.size(); ++i) members[selection_.part(i)] += selection_.free(i) ? 1 : 0;
  for (std::size_t i = 0; i < data_.frames.size(); ++i) {
    if (!selection_.free(i)) continue;
    FrameBlock& frame = state_.frames[i];
    double* values = frame.values.data();
    const std::size_t part = selection_.part(i);
    // Where nothing was measured, the start counts: of all such frames of a part together, as much as once.
    const double share = std::sqrt(members[part]);
    const AdjustmentFrame& input = data_.frames[i];
    if (input.attitude) {
      add_term(attitude_cost(frame, enu_from_camera(input.attitude->attitude), input.attitude->tilt_sigma_rad,
                             input.attitude->heading_sigma_rad),
               nullptr, {values, state_.calibration.boresight_rad.data()});
    } else {
      const double sigma = share * table::kUnmeasuredAttitudeSigma_rad;
      add_term(attitude_cost(frame, enu_from_camera(input.pose.attitude), sigma, sigma), nullptr,
               {values, no_boresight_.data()});
    }
    if (input.height) {
      add_term(height_cost(data_.ground, input.height->agl_m, input.height->relative_sigma), nullptr,
               {values, &state_.calibration.log_height_scale});
    } else {
      add_term(height_cost(data_.ground, input.pose.agl_m, share * table::kUnmeasuredHeightSigma), nullptr,
               {values, &no_scale_});
    }
    if (!selection_.anchored(part) && !gauge_held[part]) {
      const double variance = table::kGaugeSigma_m * table::kGaugeSigma_m;
      add_term(position_cost({values[0], values[1]}, variance * Eigen::Matrix2d::Identity()), nullptr, {values});
      gauge_held[part] = true;
    }
  }
  for (std::size_t a = 0; a < data_.anchors.size(); ++a) {
    const BlockAnchor& anchor = data_.anchors[a];
    if (!selection_.kept(a) || !selection_.adjusted(a)) continue;
    FrameBlock& frame = state_.frames[anchor.frame];
    if (anchor.whole) {
      add_term(pose_cost(data_.ground, frame, anchor.whole->pose, anchor.whole->covariance), switchable_pose_.get(),
               {frame.values.data()});
    } else {
      add_term(position_cost(anchor.position, anchor.covariance_m2), switchable_.get(), {frame.values.data()});
    }
  }
}

void AdjustmentRun::add_motion() {
  for (std::size_t i = 1; i < data_.frames.size(); ++i) {
    if (!selection_.motion_between(i)) continue;
    const Eigen::Vector3d step_m = data_.starts[i].centre_m() - data_.starts[i - 1].centre_m();
    add_term(motion_cost(step_m, hypotenuse(table::kMotionSigma_m, table::kMotionSigmaShare * step_m.norm())), nullptr,
             {state_.frames[i - 1].values.data(), state_.frames[i].values.data()});
  }
}

void AdjustmentRun::add_points() {
  const std::vector<double> terrain = terrain_sigmas();
  CalibrationBlock& c = state_.calibration;
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    if (!selection_.used(j)) continue;
    const TiePoint& point = data_.points[j];
    double* position = state_.points[j].data();
    for (std::size_t k = 0; k < point.observations.size(); ++k) {
      if (selection_.use(j, k) != ObservationUse::used) continue;
      const ImageObservation& o = point.observations[k];
      FrameBlock& frame = state_.frames[o.frame];
      point_terms_.push_back(problem_->AddResidualBlock(reprojection_cost(data_.lens, frame, o.pixel, o.sigma_px),
                                                        huber_.get(), frame.values.data(), &c.log_focal,
                                                        c.distortion.data(), position));
    }
    point_terms_.push_back(problem_->AddResidualBlock(terrain_cost(data_.ground, terrain[j]), nullptr, position));
    if (point.control) {
      point_terms_.push_back(
          problem_->AddResidualBlock(control_cost(point.control->place, point.control->sigma_m), nullptr, position));
    }
  }
}

// False when it came to no end within the iterations.
bool AdjustmentRun::solve(int iterations, double tolerance, double trust_region) {
  ceres::Solver::Options options;
  auto* ordering = new ceres::ParameterBlockOrdering;
  bool any_point = false;
  std::vector<double*> blocks;
  problem_->GetParameterBlocks(&blocks);
  for (double* block : blocks) ordering->AddElementToGroup(block, 1);
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    if (!selection_.used(j)) continue;
    ordering->AddElementToGroup(state_.points[j].data(), 0);
    any_point = true;
  }
  options.linear_solver_ordering.reset(ordering);
  options.linear_solver_type = any_point ? ceres::SPARSE_SCHUR : ceres::SPARSE_NORMAL_CHOLESKY;
  options.num_threads = 1;
  options.max_num_iterations = iterations;
  options.function_tolerance = tolerance;
  options.initial_trust_region_radius = trust_region;
  options.parameter_tolerance = table::kParameterTolerance;
  options.gradient_tolerance = table::kGradientTolerance;
  options.logging_type = ceres::SILENT;
  CancelCallback callback(progress_, cancel_);
  options.callbacks.push_back(&callback);
  ceres::Solver::Summary summary;
  ceres::Solve(options, problem_.get(), &summary);
  callback.rethrow();
  iterations_ += summary.num_successful_steps + summary.num_unsuccessful_steps;
  for (std::size_t i = 0; i < data_.frames.size(); ++i) {
    if (selection_.free(i)) state_.frames[i].recentre();
  }
  return summary.termination_type == ceres::CONVERGENCE;
}

bool AdjustmentRun::covariances() {
  ceres::Problem::EvaluateOptions options;
  options.num_threads = 1;
  JacobianLayout layout;
  for (std::size_t i = 0; i < data_.frames.size(); ++i) {
    if (!selection_.free(i)) continue;
    frame_indices_.push_back(i);
    options.parameter_blocks.push_back(state_.frames[i].values.data());
  }
  layout.frames = frame_indices_.size();
  CalibrationBlock& c = state_.calibration;
  for (double* block : {&c.log_focal, c.distortion.data(), c.boresight_rad.data(), &c.log_height_scale}) {
    if (problem_->IsParameterBlockConstant(block)) continue;
    options.parameter_blocks.push_back(block);
    layout.shared += static_cast<std::size_t>(problem_->ParameterBlockTangentSize(block));
  }
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    if (!selection_.used(j)) continue;
    point_indices_.push_back(j);
    options.parameter_blocks.push_back(state_.points[j].data());
  }
  layout.points = point_indices_.size();
  options.residual_blocks = frame_terms_;
  options.residual_blocks.insert(options.residual_blocks.end(), point_terms_.begin(), point_terms_.end());
  ceres::CRSMatrix jacobian;
  if (!problem_->Evaluate(options, nullptr, nullptr, nullptr, &jacobian)) return false;
  cancel_.check();
  marginal_ = marginal_covariances(jacobian, layout, data_.options.point_covariances, cancel_);
  if (!marginal_) return false;
  add_held_covariances(*marginal_);
  return true;
}

// An error that the held frames share moves the window as well.
void AdjustmentRun::add_held_covariances(MarginalCovariances& marginal) {
  std::vector<std::optional<Eigen::Matrix3d>> largest(data_.frames.size());  // by part
  for (std::size_t i = 0; i < data_.frames.size(); ++i) {
    if (selection_.free(i) || !state_.covariances[i] || selection_.observations(i) == 0) continue;
    const Eigen::Matrix3d held = state_.covariances[i]->topLeftCorner<3, 3>();
    auto& most = largest[selection_.part(i)];
    if (!most || held.trace() > most->trace()) most = held;
  }
  const auto of_frame = [&](std::size_t local) { return largest[selection_.part(frame_indices_[local])]; };
  for (std::size_t i = 0; i < marginal.frames.size(); ++i) {
    if (const auto held = of_frame(i)) marginal.frames[i].topLeftCorner<3, 3>() += *held;
  }
  for (auto& pair : marginal.pairs) {
    if (const auto held = of_frame(pair.a)) pair.covariance.topLeftCorner<3, 3>() += *held;
  }
  for (std::size_t p = 0; p < marginal.points.size(); ++p) {
    const std::size_t frame = data_.points[point_indices_[p]].observations.front().frame;
    if (const auto& held = largest[selection_.part(frame)]) marginal.points[p] += *held;
  }
}

// Of a whole adjustment; a window reports what the last one found.
void AdjustmentRun::report_calibration() {
  const CalibrationBlock& c = state_.calibration;
  CameraSelfCalibration& result = state_.reported;
  result.camera = data_.camera;
  result.camera.fx *= std::exp(c.log_focal);
  result.camera.fy *= std::exp(c.log_focal);
  result.camera.distortion = c.distortion;
  if (!whole_) return;
  // The free parameters stand in this order in the covariance.
  Eigen::Index next = 0;
  const auto calibrated = [&](double value, double prior) {
    CalibratedValue calibrated_value{value, 0};
    if (prior > 0 && marginal_) {
      calibrated_value.sigma = std::sqrt(marginal_->shared(next, next));
      ++next;
    } else if (prior > 0) {
      calibrated_value.sigma = prior;
    }
    return calibrated_value;
  };
  const CalibrationPrior& prior = data_.options.calibration;
  result.log_focal = calibrated(c.log_focal, prior.focal_relative);
  for (std::size_t i = 0; i < 5; ++i) {
    result.distortion[i] = calibrated(c.distortion[i], i == 2 || i == 3 ? prior.tangential : prior.radial);
  }
  for (std::size_t i = 0; i < 3; ++i) {
    result.boresight[i] = calibrated(c.boresight_rad[i], prior.boresight_axis_rad(i));
  }
  result.log_height_scale = calibrated(c.log_height_scale, prior.height_scale);
}

AdjustedBlock AdjustmentRun::report() const {
  AdjustedBlock block;
  block.outcome = outcome_;
  block.iterations = iterations_;
  block.calibration = state_.reported;
  for (std::size_t i = 0; i < data_.frames.size(); ++i) {
    AdjustedFrame frame;
    frame.pose = state_.frames[i].pose(data_.ground);
    frame.up_m = state_.frames[i].values[2];
    frame.state = selection_.free(i) ? state_.frame_states[i] : FrameState::held;
    if (selection_.free(i)) frame.covariance = state_.covariances[i];
    frame.observations = selection_.observations(i);
    block.floating_frames += frame.state == FrameState::floating ? 1 : 0;
    block.frames.push_back(frame);
  }
  for (std::size_t a = 0; a < data_.anchors.size(); ++a) {
    if (!selection_.adjusted(a)) continue;
    const BlockAnchor& anchor = data_.anchors[a];
    const double chi2 = selection_.anchor_chi2(anchor);
    const double bound = anchor.whole ? table::kPoseAnchorBound : table::kAnchorBound;
    block.anchors.push_back({a, !selection_.kept(a), switch_value(chi2, bound), chi2,
                             state_.frames[anchor.frame].centre_m().head<2>() - anchor.position.vector()});
  }
  double sum = 0, squares = 0;
  for (std::size_t j = 0; j < data_.points.size(); ++j) {
    const TiePoint& point = data_.points[j];
    AdjustedPoint adjusted_point;
    adjusted_point.used = selection_.used(j);
    adjusted_point.position_m = state_.points[j];
    if (selection_.used(j) && point.control) {
      adjusted_point.control_residual_m = state_.points[j].head<2>() - point.control->place.vector();
    }
    for (std::size_t k = 0; k < point.observations.size(); ++k) {
      const ImageObservation& o = point.observations[k];
      AdjustedObservation observation{selection_.use(j, k)};
      if (state_.point_known[j]) {
        const auto pixel = project(data_.lens, state_.calibration, state_.frames[o.frame], state_.points[j]);
        if (pixel) observation.residual_px = *pixel - o.pixel;
      }
      if (observation.use == ObservationUse::used) {
        ++block.observations;
        sum += observation.residual_px.norm();
        squares += observation.residual_px.squaredNorm();
      }
      block.rejected_observations +=
          observation.use == ObservationUse::outlier || observation.use == ObservationUse::behind_camera ? 1 : 0;
      adjusted_point.observations.push_back(observation);
    }
    block.points.push_back(std::move(adjusted_point));
  }
  if (block.observations > 0) {
    block.mean_reprojection_px = sum / static_cast<double>(block.observations);
    block.rms_reprojection_px = std::sqrt(squares / static_cast<double>(block.observations));
  }
  if (!marginal_) return block;
  for (std::size_t p = 0; p < marginal_->points.size(); ++p) {
    const std::size_t j = point_indices_[p];
    const bool anchored = std::any_of(data_.points[j].observations.begin(), data_.points[j].observations.end(),
                                      [&](const ImageObservation& o) {
                                        return selection_.free(o.frame) && selection_.observations(o.frame) > 0 &&
                                               state_.frame_states[o.frame] == FrameState::anchored;
                                      });
    if (anchored) block.points[j].covariance_m2 = marginal_->points[p];
  }
  for (const auto& pair : marginal_->pairs) {
    const std::size_t a = frame_indices_[pair.a], b = frame_indices_[pair.b];
    if (state_.frame_states[a] == FrameState::anchored) block.cross_covariances.push_back({a, b, pair.covariance});
  }
  return block;
}

AdjustedBlock AdjustmentRun::run() {
  constexpr int kMostIterations = static_cast<int>(table::kAnchorWidening.size()) * table::kAnnealingIterations +
                                  table::kDecisionRounds * table::kFinalIterations;
  const bool any = selection_.any_free();
  if (any) {
    progress_.begin("block adjustment", static_cast<std::uint64_t>(kMostIterations), "iterations");
    cancel_.check();
    selection_.place_points();
    build();
    for (std::size_t round = 0; round < table::kAnchorWidening.size(); ++round) {
      anchor_bound_ = table::kAnchorBound * table::kAnchorWidening[round];
      pose_bound_ = table::kPoseAnchorBound * table::kAnchorWidening[round];
      huber_width_ = table::kObservationHuber * table::kObservationWidening[round];
      solve(table::kAnnealingIterations, table::kAnnealingTolerance,
            round == 0 ? table::kFarTrustRegion : table::kNearTrustRegion);
    }
    settled_ = true;
    for (int round = 0; round < table::kDecisionRounds; ++round) {
      if (!selection_.decide() && round > 0) break;
      build();
      outcome_ = solve(table::kFinalIterations, table::kFinalTolerance, table::kNearTrustRegion)
                     ? AdjustmentOutcome::converged
                     : AdjustmentOutcome::iteration_limit;
    }
    if (data_.options.covariances && !covariances()) outcome_ = AdjustmentOutcome::underdetermined;
    for (std::size_t i = 0; i < data_.frames.size(); ++i) {
      if (!selection_.free(i)) continue;
      state_.frame_states[i] = selection_.anchored(selection_.part(i)) ? FrameState::anchored : FrameState::floating;
      state_.covariances[i].reset();
    }
    for (std::size_t local = 0; marginal_ && local < frame_indices_.size(); ++local) {
      const std::size_t i = frame_indices_[local];
      if (state_.frame_states[i] == FrameState::anchored) state_.covariances[i] = marginal_->frames[local];
    }
  }
  report_calibration();
  AdjustedBlock block = report();
  if (any) progress_.end();
  return block;
}

}  // namespace

AdjustedBlock run_adjustment(const BlockData& data, BlockState& state, FrameWindow window, Progress& progress,
                             const Cancel& cancel) {
  return AdjustmentRun(data, state, window, progress, cancel).run();
}

}  // namespace nadir
