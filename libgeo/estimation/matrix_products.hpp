// Products of views of any size, compiled once: Eigen's own of fixed sizes are instantiated for each pair of types,
// which takes a compiler most of a minute for a filter. The order of the additions is the same, and so are the last
// bits.
#pragma once

#include <Eigen/Core>

namespace nadir {

using MatrixView = Eigen::Ref<const Eigen::MatrixXd>;

Eigen::MatrixXd product(const MatrixView& a, const MatrixView& b);
// a bᵀ, as (b aᵀ)ᵀ: the order in which Eigen adds up a product with a transposed matrix inside a sum.
Eigen::MatrixXd product_transposed(const MatrixView& a, const MatrixView& b);
// A P Aᵀ
Eigen::MatrixXd congruence(const MatrixView& a, const MatrixView& p);

}  // namespace nadir
