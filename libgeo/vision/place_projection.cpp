#include "vision/place_projection.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace nadir {

PlaceVector PlaceProjection::project(const RawPlaceDescriptor& descriptor) const {
  using Row = Eigen::Matrix<float, 1, Eigen::Dynamic>;
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto size = static_cast<Eigen::Index>(kRawPlaceSize);
  const Row centred = Eigen::Map<const Row>(descriptor.data(), size) - Eigen::Map<const Row>(mean.data(), size);
  const Eigen::Map<const Rows> components(basis.data(), static_cast<Eigen::Index>(kPlaceSize), size);
  PlaceVector result{};
  Eigen::Map<Eigen::VectorXf> vector(result.data(), static_cast<Eigen::Index>(kPlaceSize));
  vector = components * centred.transpose();
  const float length = vector.norm();
  if (length > 1e-9F) vector /= length;
  return result;
}

PlaceProjection train_projection(std::span<const RawPlaceDescriptor> samples) {
  const auto size = static_cast<Eigen::Index>(kRawPlaceSize);
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(samples.size()), size);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    for (std::size_t k = 0; k < kRawPlaceSize; ++k) {
      rows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = static_cast<double>(samples[i][k]);
    }
  }
  const Eigen::RowVectorXd mean = rows.colwise().mean();
  rows.rowwise() -= mean;
  const Eigen::MatrixXd covariance =
      rows.transpose() * rows / static_cast<double>(std::max<std::size_t>(1, samples.size() - 1));
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance);

  PlaceProjection projection;
  projection.mean.resize(kRawPlaceSize);
  projection.basis.resize(kPlaceSize * kRawPlaceSize);
  for (Eigen::Index k = 0; k < size; ++k) {
    projection.mean[static_cast<std::size_t>(k)] = static_cast<float>(mean[k]);
  }
  double kept = 0;
  for (std::size_t row = 0; row < kPlaceSize; ++row) {
    const Eigen::Index from = size - 1 - static_cast<Eigen::Index>(row);  // eigenvalues come in rising order
    Eigen::VectorXd component = solver.eigenvectors().col(from);
    Eigen::Index largest = 0;
    component.cwiseAbs().maxCoeff(&largest);
    if (component[largest] < 0) component = -component;
    for (Eigen::Index k = 0; k < size; ++k) {
      projection.basis[row * kRawPlaceSize + static_cast<std::size_t>(k)] = static_cast<float>(component[k]);
    }
    kept += std::max(0.0, solver.eigenvalues()[from]);
  }
  const double all = solver.eigenvalues().cwiseMax(0).sum();
  projection.kept = all > 0 ? kept / all : 1;
  return projection;
}

}  // namespace nadir
