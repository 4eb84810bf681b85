#include "adjustment/marginal_covariance.hpp"

#include <ceres/crs_matrix.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>

#include "adjustment/selected_inverse.hpp"

namespace nadir {
namespace {

constexpr std::size_t kNoPoint = std::numeric_limits<std::size_t>::max();

// The normal equations of one point: HᵀH of its rows, with frames in ascending order.
struct PointEquations {
  std::vector<std::uint32_t> frames;
  Eigen::Matrix3d inverse;                             // H_pp⁻¹
  std::vector<Eigen::Matrix<double, 3, 6>> by_frame;   // H_pc
  Eigen::Matrix<double, 3, Eigen::Dynamic> by_shared;  // H_ps
  bool determined = false;
};

class JacobianRows {
 public:
  JacobianRows(const ceres::CRSMatrix& jacobian, const JacobianLayout& layout)
      : j_(jacobian), layout_(layout), first_shared_(6 * layout.frames), first_point_(first_shared_ + layout.shared) {}

  std::size_t count() const { return static_cast<std::size_t>(j_.num_rows); }
  std::size_t begin(std::size_t row) const { return static_cast<std::size_t>(j_.rows[row]); }
  std::size_t end(std::size_t row) const { return begin(row + 1); }
  std::size_t column(std::size_t entry) const { return static_cast<std::size_t>(j_.cols[entry]); }
  double value(std::size_t entry) const { return j_.values[entry]; }

  bool is_frame(std::size_t column) const { return column < first_shared_; }
  bool is_shared(std::size_t column) const { return column >= first_shared_ && column < first_point_; }
  std::size_t shared(std::size_t column) const { return column - first_shared_; }
  std::size_t point_of(std::size_t row) const {
    for (std::size_t e = begin(row); e < end(row); ++e) {
      if (column(e) >= first_point_) return (column(e) - first_point_) / 3;
    }
    return kNoPoint;
  }

  // Rows [from, to) are one point's. Each row's frame part (at most one frame), shared part and point part.
  struct Parts {
    std::size_t frame = kNoPoint;
    Eigen::Matrix<double, 1, 6> by_frame;
    Eigen::RowVectorXd by_shared;
    Eigen::RowVector3d by_point;
  };
  void parts(std::size_t row, Parts& parts) const {
    parts.frame = kNoPoint;
    parts.by_frame.setZero();
    parts.by_shared.setZero(static_cast<Eigen::Index>(layout_.shared));
    parts.by_point.setZero();
    for (std::size_t e = begin(row); e < end(row); ++e) {
      const std::size_t c = column(e);
      if (is_frame(c)) {
        parts.frame = c / 6;
        parts.by_frame[static_cast<Eigen::Index>(c % 6)] = value(e);
      } else if (is_shared(c)) {
        parts.by_shared[static_cast<Eigen::Index>(shared(c))] = value(e);
      } else {
        parts.by_point[static_cast<Eigen::Index>((c - first_point_) % 3)] = value(e);
      }
    }
  }

  PointEquations point_equations(std::size_t from, std::size_t to) const {
    PointEquations point;
    point.by_shared.setZero(3, static_cast<Eigen::Index>(layout_.shared));
    Eigen::Matrix3d own = Eigen::Matrix3d::Zero();
    Parts p;
    for (std::size_t row = from; row < to; ++row) {
      for (std::size_t e = begin(row); e < end(row); ++e) {
        if (is_frame(column(e))) point.frames.push_back(static_cast<std::uint32_t>(column(e) / 6));
      }
    }
    std::sort(point.frames.begin(), point.frames.end());
    point.frames.erase(std::unique(point.frames.begin(), point.frames.end()), point.frames.end());
    point.by_frame.assign(point.frames.size(), Eigen::Matrix<double, 3, 6>::Zero());
    for (std::size_t row = from; row < to; ++row) {
      parts(row, p);
      own.noalias() += p.by_point.transpose() * p.by_point;
      point.by_shared.noalias() += p.by_point.transpose() * p.by_shared;
      if (p.frame != kNoPoint) {
        const auto at = std::lower_bound(point.frames.begin(), point.frames.end(), p.frame) - point.frames.begin();
        point.by_frame[static_cast<std::size_t>(at)].noalias() += p.by_point.transpose() * p.by_frame;
      }
    }
    const Eigen::LLT<Eigen::Matrix3d> cholesky(own);
    point.determined = cholesky.info() == Eigen::Success;
    if (point.determined) point.inverse = cholesky.solve(Eigen::Matrix3d::Identity());
    return point;
  }

 private:
  const ceres::CRSMatrix& j_;
  JacobianLayout layout_;
  std::size_t first_shared_, first_point_;
};

// The reduced system [A B; Bᵀ D].
struct ReducedSystem {
  SelectedInverse a;
  Eigen::MatrixXd b, d;
};

std::vector<SelectedInverse::Pair> pairs_of(const JacobianRows& rows) {
  std::vector<SelectedInverse::Pair> pairs;
  std::vector<std::uint32_t> frames;
  const auto flush = [&] {
    std::sort(frames.begin(), frames.end());
    frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
    for (std::size_t a = 0; a < frames.size(); ++a) {
      for (std::size_t b = 0; b < a; ++b) pairs.emplace_back(frames[a], frames[b]);
    }
    frames.clear();
  };
  std::size_t previous = kNoPoint;
  for (std::size_t row = 0; row < rows.count(); ++row) {
    const std::size_t point = rows.point_of(row);
    if (point == kNoPoint || point != previous) flush();
    previous = point;
    for (std::size_t e = rows.begin(row); e < rows.end(row); ++e) {
      if (rows.is_frame(rows.column(e))) frames.push_back(static_cast<std::uint32_t>(rows.column(e) / 6));
    }
  }
  flush();
  return pairs;
}

// A row without a point: its outer product.
void add_plain_row(const JacobianRows& rows, std::size_t row, ReducedSystem& system) {
  for (std::size_t e = rows.begin(row); e < rows.end(row); ++e) {
    const std::size_t c = rows.column(e);
    for (std::size_t f = rows.begin(row); f < rows.end(row); ++f) {
      const std::size_t g = rows.column(f);
      const double product = rows.value(e) * rows.value(f);
      if (product == 0) continue;
      if (rows.is_frame(c) && rows.is_frame(g)) {
        if (c / 6 < g / 6) continue;  // its transpose is added
        SelectedInverse::Block block = SelectedInverse::Block::Zero();
        block(static_cast<Eigen::Index>(c % 6), static_cast<Eigen::Index>(g % 6)) = product;
        system.a.add(c / 6, g / 6, block);
      } else if (rows.is_frame(c)) {
        system.b(static_cast<Eigen::Index>(c), static_cast<Eigen::Index>(rows.shared(g))) += product;
      } else if (rows.is_shared(g)) {
        system.d(static_cast<Eigen::Index>(rows.shared(c)), static_cast<Eigen::Index>(rows.shared(g))) += product;
      }
    }
  }
}

void add_point(const JacobianRows& rows, std::size_t from, std::size_t to, const PointEquations& point,
               ReducedSystem& system) {
  JacobianRows::Parts p;
  for (std::size_t row = from; row < to; ++row) {
    rows.parts(row, p);
    system.d.noalias() += p.by_shared.transpose() * p.by_shared;
    if (p.frame == kNoPoint) continue;
    system.a.add(p.frame, p.frame, p.by_frame.transpose() * p.by_frame);
    system.b.middleRows<6>(static_cast<Eigen::Index>(6 * p.frame)).noalias() += p.by_frame.transpose() * p.by_shared;
  }
  system.d.noalias() -= point.by_shared.transpose() * point.inverse * point.by_shared;
  for (std::size_t a = 0; a < point.frames.size(); ++a) {
    const Eigen::Matrix<double, 6, 3> left = point.by_frame[a].transpose() * point.inverse;
    system.b.middleRows<6>(static_cast<Eigen::Index>(6 * point.frames[a])).noalias() -= left * point.by_shared;
    for (std::size_t b = 0; b <= a; ++b) {
      system.a.add(point.frames[a], point.frames[b], -left * point.by_frame[b]);
    }
  }
}

// Σ of two frames, from A⁻¹ and the border.
PoseCovariance frame_block(const PoseCovariance& inverse, const Eigen::MatrixXd& w, const Eigen::MatrixXd& shared,
                           std::size_t a, std::size_t b) {
  return inverse + w.middleRows<6>(static_cast<Eigen::Index>(6 * a)) * shared *
                       w.middleRows<6>(static_cast<Eigen::Index>(6 * b)).transpose();
}

Eigen::Matrix3d point_covariance(const PointEquations& point, const SelectedInverse& a, const Eigen::MatrixXd& w,
                                 const Eigen::MatrixXd& shared) {
  std::vector<Eigen::Matrix<double, 3, 6>> gain;
  for (const auto& by_frame : point.by_frame) gain.push_back(point.inverse * by_frame);
  // The shared parameters act directly, and through the frames: Σ_ys = (-W Σ_ss, Σ_ss).
  Eigen::MatrixXd by_shared = point.inverse * point.by_shared;
  Eigen::Matrix3d covariance = point.inverse;
  SelectedInverse::Block block;
  for (std::size_t i = 0; i < gain.size(); ++i) {
    by_shared.noalias() -= gain[i] * w.middleRows<6>(static_cast<Eigen::Index>(6 * point.frames[i]));
    for (std::size_t j = 0; j <= i; ++j) {
      if (!a.find(point.frames[i], point.frames[j], block)) continue;  // never: they see this point together
      const Eigen::Matrix3d part = gain[i] * block * gain[j].transpose();
      covariance += part;
      if (i != j) covariance += part.transpose();
    }
  }
  covariance += by_shared * shared * by_shared.transpose();
  return covariance;
}

}  // namespace

std::optional<MarginalCovariances> marginal_covariances(const ceres::CRSMatrix& jacobian, const JacobianLayout& layout,
                                                        bool points, const Cancel& cancel) {
  const JacobianRows rows(jacobian, layout);
  const auto shared = static_cast<Eigen::Index>(layout.shared);
  ReducedSystem system{SelectedInverse(layout.frames, pairs_of(rows)),
                       Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(6 * layout.frames), shared),
                       Eigen::MatrixXd::Zero(shared, shared)};
  // Rows of each point, [from, to).
  std::vector<std::pair<std::size_t, std::size_t>> spans(layout.points, {0, 0});
  for (std::size_t row = 0; row < rows.count();) {
    const std::size_t point = rows.point_of(row);
    if (point == kNoPoint) {
      add_plain_row(rows, row++, system);
      continue;
    }
    std::size_t to = row;
    while (to < rows.count() && rows.point_of(to) == point) ++to;
    spans[point] = {row, to};
    const PointEquations equations = rows.point_equations(row, to);
    if (!equations.determined) return std::nullopt;
    cancel.check();
    add_point(rows, row, to, equations, system);
    row = to;
  }
  if (!system.a.factorize(cancel)) return std::nullopt;
  const Eigen::MatrixXd w = system.a.solve(system.b);
  MarginalCovariances result;
  const Eigen::MatrixXd left = system.d - system.b.transpose() * w;
  const Eigen::LLT<Eigen::MatrixXd> cholesky(0.5 * (left + left.transpose()));
  if (shared > 0 && cholesky.info() != Eigen::Success) return std::nullopt;
  result.shared = shared > 0 ? Eigen::MatrixXd(cholesky.solve(Eigen::MatrixXd::Identity(shared, shared))) : left;
  system.a.invert(cancel);
  for (std::size_t i = 0; i < layout.frames; ++i) {
    result.frames.push_back(frame_block(system.a.diagonal(i), w, result.shared, i, i));
    if (!result.frames.back().allFinite()) return std::nullopt;
  }
  SelectedInverse::Block block;
  for (const auto& [a, b] : system.a.pairs()) {
    if (system.a.find(a, b, block)) result.pairs.push_back({a, b, frame_block(block, w, result.shared, a, b)});
  }
  if (points) {
    for (const auto& [from, to] : spans) {
      cancel.check();
      result.points.push_back(point_covariance(rows.point_equations(from, to), system.a, w, result.shared));
    }
  }
  return result;
}

}  // namespace nadir
