#include "adjustment/selected_inverse.hpp"

#include <Eigen/Dense>

#include "base/random.hpp"

using namespace nadir;

namespace {

using Block = SelectedInverse::Block;

struct DrawnMatrix {
  std::vector<SelectedInverse::Pair> pairs;
  Eigen::MatrixXd dense;
};

// Positive definite, with a chain of neighbours and some pairs that are far apart.
DrawnMatrix draw_matrix(std::size_t size, std::size_t far, std::uint64_t seed) {
  Random random(seed);
  DrawnMatrix drawn;
  for (std::uint32_t i = 1; i < size; ++i) drawn.pairs.emplace_back(i - 1, i);  // in either order
  for (std::size_t k = 0; k < far; ++k) {
    const auto a = static_cast<std::uint32_t>(random.integer(0, static_cast<int>(size) - 1));
    const auto b = static_cast<std::uint32_t>(random.integer(0, static_cast<int>(size) - 1));
    if (a != b) drawn.pairs.emplace_back(a, b);
  }
  const auto rows = static_cast<Eigen::Index>(6 * size);
  drawn.dense = Eigen::MatrixXd::Identity(rows, rows);
  for (const auto& [a, b] : drawn.pairs) {
    Eigen::MatrixXd row = Eigen::MatrixXd::Zero(6, rows);
    for (Eigen::Index r = 0; r < 6; ++r) {
      for (Eigen::Index c = 0; c < 6; ++c) {
        row(r, 6 * static_cast<Eigen::Index>(a) + c) = random.normal();
        row(r, 6 * static_cast<Eigen::Index>(b) + c) = random.normal();
      }
    }
    drawn.dense += row.transpose() * row;
  }
  return drawn;
}

SelectedInverse filled(const DrawnMatrix& drawn) {
  SelectedInverse matrix(static_cast<std::size_t>(drawn.dense.rows() / 6), drawn.pairs);
  const auto at = [](std::size_t i) { return static_cast<Eigen::Index>(6 * i); };
  for (std::size_t i = 0; i < matrix.size(); ++i) matrix.add(i, i, drawn.dense.block<6, 6>(at(i), at(i)));
  for (const auto& [a, b] : matrix.pairs()) matrix.add(a, b, drawn.dense.block<6, 6>(at(a), at(b)));
  return matrix;
}

}  // namespace

TEST(SelectedInverse, EqualsTheDenseInverse) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const std::size_t size = 1 + 3 * seed;
    const DrawnMatrix drawn = draw_matrix(size, size / 2, seed);
    SelectedInverse matrix = filled(drawn);
    ASSERT_TRUE(matrix.factorize());
    const Eigen::MatrixXd inverse = drawn.dense.inverse();
    const Eigen::MatrixXd b = Eigen::MatrixXd::Random(drawn.dense.rows(), 3);
    EXPECT_LT((matrix.solve(b) - inverse * b).norm(), 1e-9 * b.norm()) << seed;
    matrix.invert();
    Block block;
    for (std::size_t i = 0; i < size; ++i) {
      const auto at = static_cast<Eigen::Index>(6 * i);
      EXPECT_LT((matrix.diagonal(i) - inverse.block<6, 6>(at, at)).norm(), 1e-9) << seed << " " << i;
    }
    for (const auto& [a, c] : matrix.pairs()) {
      const auto row = static_cast<Eigen::Index>(6 * a), column = static_cast<Eigen::Index>(6 * c);
      ASSERT_TRUE(matrix.find(a, c, block));
      EXPECT_LT((block - inverse.block<6, 6>(row, column)).norm(), 1e-9);
      ASSERT_TRUE(matrix.find(c, a, block));
      EXPECT_LT((block - inverse.block<6, 6>(column, row)).norm(), 1e-9);
    }
  }
}

TEST(SelectedInverse, LittleFillOnAChain) {
  std::vector<SelectedInverse::Pair> pairs;
  for (std::uint32_t i = 1; i < 500; ++i) pairs.emplace_back(i, i - 1);
  EXPECT_EQ(SelectedInverse(500, pairs).factor_blocks(), pairs.size());
}

TEST(SelectedInverse, RefusesAMatrixThatIsNotPositiveDefinite) {
  DrawnMatrix drawn = draw_matrix(5, 2, 4);
  drawn.dense(17, 17) = -1;
  EXPECT_FALSE(filled(drawn).factorize());
  drawn.dense.row(17).setZero();
  drawn.dense.col(17).setZero();
  EXPECT_FALSE(filled(drawn).factorize());
  drawn.dense(17, 17) = std::nan("");
  EXPECT_FALSE(filled(drawn).factorize());
}
