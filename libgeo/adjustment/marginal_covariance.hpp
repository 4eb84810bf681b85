// Covariances of frames, shared parameters and points from the Jacobian of an adjustment at its optimum.
//
// With J's columns of frames (c), shared parameters (s) and points (p), the points are eliminated one by one:
//   H = JᵀJ,   S = H_yy - H_yp H_pp⁻¹ H_py   with y = (c, s).
// S has a dense border, the shared parameters: S = [A B; Bᵀ D]. With W = A⁻¹ B,
//   Σ_ss = (D - Bᵀ W)⁻¹,   Σ_cs = -W Σ_ss,   Σ_cc = A⁻¹ + W Σ_ss Wᵀ,   Σ_pp = H_pp⁻¹ + K Σ_yy Kᵀ,  K = H_pp⁻¹ H_py.
// A⁻¹ is needed only for frames that see a point together: selected_inverse.hpp.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "adjustment/pose_covariance.hpp"
#include "base/progress.hpp"

namespace ceres {
struct CRSMatrix;
}

namespace nadir {

// Columns: six for each frame, then the shared ones, then three for each point. Rows of the same point stand together,
// and a row without a point has no shared column unless all its columns are shared or of one frame.
struct JacobianLayout {
  std::size_t frames = 0, shared = 0, points = 0;
};

struct MarginalCovariances {
  struct Cross {
    std::size_t a = 0, b = 0;  // a > b
    PoseCovariance covariance;
  };
  std::vector<PoseCovariance> frames;
  std::vector<Cross> pairs;  // of frames that see a point together; sorted
  Eigen::MatrixXd shared;
  std::vector<Eigen::Matrix3d> points;  // empty unless asked for
};

// Nothing when some combination of parameters is not determined. Throws Interrupted.
std::optional<MarginalCovariances> marginal_covariances(const ceres::CRSMatrix& jacobian, const JacobianLayout& layout,
                                                        bool points, const Cancel& cancel = {});

}  // namespace nadir
