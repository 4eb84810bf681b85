// The blocks of the inverse of a large sparse matrix that are worth having: marginal covariances of frames.
//
// A is symmetric and positive definite, of blocks of six (a frame's position and rotation); block (i, j) differs from
// zero where frames i and j see the same point. Its inverse, the covariance, is dense: 18 000² numbers for 3000 frames.
// But with A = U D Uᵀ (U unit lower triangular, block by block) the inverse Z obeys
//   Z = D⁻¹ U⁻¹ + (I - Uᵀ) Z,
// and read for the blocks where U has entries, from the last column to the first, that is a recursion among those
// blocks alone (Takahashi, Fagan and Chen 1973; Erisman and Tinney 1975; for adjustments of geodetic networks Golub and
// Plemmons 1980):
//   Z_ij = -Σ_k Z_ik U_kj                 (i > j; k over the entries of column j)
//   Z_jj = D_j⁻¹ - Σ_k U_kjᵀ Z_kj.
// The result is exact, at about the cost of three factorizations. It holds all diagonal blocks and those of all pairs
// of A's pattern. Columns are eliminated by approximate minimum degree on the graph of blocks.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/progress.hpp"

namespace nadir {

class SelectedInverse {
 public:
  using Block = Eigen::Matrix<double, 6, 6>;
  using Pair = std::pair<std::uint32_t, std::uint32_t>;

  // size: rows of blocks. pairs: of different indices whose block may differ from zero, in any order, repeated or not.
  SelectedInverse(std::size_t size, std::vector<Pair> pairs);

  std::size_t size() const { return diagonal_.size(); }
  // Adds to block (i, j), and its transpose to (j, i); i == j or a pair of the pattern.
  void add(std::size_t i, std::size_t j, const Block& block);

  // False when the matrix is not positive definite: some combination of frames is not determined. Call once. Throws
  // Interrupted.
  bool factorize(const Cancel& cancel = {});
  // After factorize(): A⁻¹ b for each column of b, which has 6 · size() rows.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const;
  // After factorize(), once; overwrites the factor, so that solve() comes first.
  void invert(const Cancel& cancel = {});

  // After invert(): a block of the inverse; nullptr where (i, j) with i > j is not in the pattern. Of i < j: transpose
  // that of (j, i).
  const Block& diagonal(std::size_t i) const { return diagonal_[position_[i]]; }
  bool find(std::size_t i, std::size_t j, Block& block) const;
  // The pairs of the pattern, i > j, sorted.
  const std::vector<Pair>& pairs() const { return pairs_; }
  std::size_t factor_blocks() const { return rows_.size(); }

 private:
  std::size_t slot(std::uint32_t row, std::uint32_t column) const;  // of the factor; rows_.size(): none

  std::vector<Pair> pairs_;
  std::vector<std::uint32_t> position_;  // in the order of elimination, by index
  std::vector<std::size_t> begin_;       // of each column's blocks below the diagonal
  std::vector<std::uint32_t> rows_;      // of those blocks, ascending
  std::vector<Block> blocks_;            // A, then its Cholesky factor, then the inverse; in the order of elimination
  std::vector<Block> diagonal_;
};

}  // namespace nadir
