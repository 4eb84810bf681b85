#include "estimation/matrix_products.hpp"

namespace nadir {

Eigen::MatrixXd product(const MatrixView& a, const MatrixView& b) {
  Eigen::MatrixXd result(a.rows(), b.cols());
  result.noalias() = a * b;
  return result;
}

Eigen::MatrixXd product_transposed(const MatrixView& a, const MatrixView& b) {
  return product(b, a.transpose()).transpose();
}

Eigen::MatrixXd congruence(const MatrixView& a, const MatrixView& p) { return product_transposed(product(a, p), a); }

}  // namespace nadir
