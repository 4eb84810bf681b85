// Robust least squares, shared by the solvers of poses (camera_pose_solver, estimation/two_view_motion).
//
// Unknowns x = (east, north in metres; six or more dimensionless ones: logarithms, radians, slopes). Minimized is
//
//   Σ_i ρ(|r_i(x)|) weighted by the information W_i  +  the priors,      ρ of Geman-McClure with scale s,
//
// as iteratively reweighted Gauss-Newton: with J_i the Jacobian of what is predicted and r_i = measured - predicted,
//
//   (Σ J_iᵀ w_i J_i + Λ_prior) δ = Σ J_iᵀ w_i r_i + g_prior,     w_i = (s² / (s² + |r_i|²))² W_i.
//
// Graduated non-convexity (Blake and Zisserman 1987; Yang et al. 2020): s begins large, where the cost is nearly
// convex, and narrows while the iteration runs, so that distant outliers lose their weight altogether.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vision/localizer_parameters.hpp"

namespace nadir {

template <int kUnknowns>
struct NormalEquations {
  using Vector = Eigen::Matrix<double, kUnknowns, 1>;
  using Matrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  using Jacobian = Eigen::Matrix<double, 2, kUnknowns>;

  Matrix information = Matrix::Zero();
  Vector gradient = Vector::Zero();

  // weight: a number, or a symmetric 2 x 2 matrix.
  template <typename Weight>
  void add(const Jacobian& jacobian, const Weight& weight, const Eigen::Vector2d& residual) {
    information += jacobian.transpose() * weight * jacobian;
    gradient += jacobian.transpose() * weight * residual;
  }
};

// Of a residual of this squared length: between 0 and 1.
inline double geman_mcclure_weight(double squared, double scale) {
  const double shrink = scale * scale / (scale * scale + squared);
  return shrink * shrink;
}

// Central differences over the unknowns from the third on: predictions are cheap, this is clearer than the closed form,
// and it is exact to 1e-9 for projections. The derivative with respect to the position (the first two) is one.
// ahead(k), behind(k): the prediction (a position or a displacement) with unknown k changed by ± kJacobianStep; nothing
// where there is none.
template <int kUnknowns, typename Ahead, typename Behind>
std::optional<Eigen::Matrix<double, 2, kUnknowns>> numeric_jacobian(const Ahead& ahead, const Behind& behind) {
  Eigen::Matrix<double, 2, kUnknowns> jacobian = Eigen::Matrix<double, 2, kUnknowns>::Zero();
  jacobian(0, 0) = jacobian(1, 1) = 1;
  for (int k = 2; k < kUnknowns; ++k) {
    const auto a = ahead(k), b = behind(k);
    if (!a || !b) return std::nullopt;
    jacobian.col(k) = (*a - *b) / (2 * kJacobianStep);
  }
  return jacobian;
}

// Problem:
//   std::optional<NormalEquations<N>> linearize()  at its present state, priors included; nothing where it is undefined
//   void apply(const Vector& step)
//   bool finished(bool converged)                  after each step: narrows the scale; true: this was the last
// False when the problem is undefined somewhere on the way, or diverges.
template <typename Problem>
bool robust_gauss_newton(Problem& problem, int max_iterations) {
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    const auto normal = problem.linearize();
    if (!normal) return false;
    const auto step = normal->information.ldlt().solve(normal->gradient).eval();
    constexpr int kDimensionless = decltype(step)::RowsAtCompileTime - 2;
    if (!step.allFinite() || step.template tail<kDimensionless>().cwiseAbs().maxCoeff() > kDivergedStep) return false;
    problem.apply(step);
    const bool converged = step.template head<2>().norm() < kConvergedStep_m &&
                           step.template tail<kDimensionless>().norm() < kConvergedStep;
    if (problem.finished(converged)) break;
  }
  return true;
}

// How many independent measurements a set of correlated ones is worth.
//
// Patches overlap, a roof displaces all features on it, a rolling shutter bends whole rows: residuals of neighbours are
// alike, and counting each as independent makes a solution look more certain than it is. Their correlation over
// distance is estimated from the residuals themselves: N / (1 + mean over the measurements of the sum of the others'
// correlations).
//
// positions and residuals: same length, same (any) unit each. Between 1 and their number. Deterministic.
double effective_sample_size(const std::vector<Eigen::Vector2d>& positions,
                             const std::vector<Eigen::Vector2d>& residuals);

}  // namespace nadir
