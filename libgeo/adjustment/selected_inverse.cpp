#include "adjustment/selected_inverse.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <limits>

namespace nadir {
namespace {

using Block = SelectedInverse::Block;
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

// The position of each index in an order of elimination with little fill.
std::vector<std::uint32_t> elimination_order(std::size_t size, const std::vector<SelectedInverse::Pair>& pairs) {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(2 * pairs.size() + size);
  for (std::size_t i = 0; i < size; ++i) entries.emplace_back(static_cast<int>(i), static_cast<int>(i), 1.0);
  for (const auto& [i, j] : pairs) {
    entries.emplace_back(static_cast<int>(i), static_cast<int>(j), 1.0);
    entries.emplace_back(static_cast<int>(j), static_cast<int>(i), 1.0);
  }
  Eigen::SparseMatrix<double> graph(static_cast<int>(size), static_cast<int>(size));
  graph.setFromTriplets(entries.begin(), entries.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
  Eigen::AMDOrdering<int>()(graph, order);
  std::vector<std::uint32_t> position(size);
  for (std::size_t k = 0; k < size; ++k) {
    position[static_cast<std::size_t>(order.indices()[static_cast<Eigen::Index>(k)])] = static_cast<std::uint32_t>(k);
  }
  return position;
}

}  // namespace

SelectedInverse::SelectedInverse(std::size_t size, std::vector<Pair> pairs)
    : pairs_(std::move(pairs)), diagonal_(size, Block::Zero()) {
  for (auto& [i, j] : pairs_) {
    if (i < j) std::swap(i, j);
  }
  std::sort(pairs_.begin(), pairs_.end());
  pairs_.erase(std::unique(pairs_.begin(), pairs_.end()), pairs_.end());
  position_ = elimination_order(size, pairs_);

  // Symbolic factorization: a column has A's entries and those of its children in the elimination tree.
  std::vector<std::vector<std::uint32_t>> columns(size), children(size);
  for (const auto& [i, j] : pairs_) {
    const auto [first, last] = std::minmax(position_[i], position_[j]);
    columns[first].push_back(last);
  }
  begin_.assign(size + 1, 0);
  for (std::uint32_t j = 0; j < size; ++j) {
    auto& rows = columns[j];
    for (const std::uint32_t child : children[j]) {
      rows.insert(rows.end(), columns[child].begin() + 1, columns[child].end());  // the first is j itself
    }
    std::sort(rows.begin(), rows.end());
    rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
    if (!rows.empty()) children[rows.front()].push_back(j);
    begin_[j + 1] = begin_[j] + rows.size();
  }
  rows_.reserve(begin_[size]);
  for (const auto& rows : columns) rows_.insert(rows_.end(), rows.begin(), rows.end());
  blocks_.assign(rows_.size(), Block::Zero());
}

std::size_t SelectedInverse::slot(std::uint32_t row, std::uint32_t column) const {
  const auto first = rows_.begin() + static_cast<std::ptrdiff_t>(begin_[column]);
  const auto last = rows_.begin() + static_cast<std::ptrdiff_t>(begin_[column + 1]);
  const auto found = std::lower_bound(first, last, row);
  return found == last || *found != row ? rows_.size() : static_cast<std::size_t>(found - rows_.begin());
}

void SelectedInverse::add(std::size_t i, std::size_t j, const Block& block) {
  const std::uint32_t row = position_[i], column = position_[j];
  if (row == column) {
    diagonal_[row] += block;
  } else if (row > column) {
    blocks_[slot(row, column)] += block;
  } else {
    blocks_[slot(column, row)] += block.transpose();
  }
}

bool SelectedInverse::factorize(const Cancel& cancel) {
  const auto size = static_cast<std::uint32_t>(diagonal_.size());
  // Left-looking: column j is updated by all columns k with an entry in row j. Each such column stands in the list of
  // the row that it updates next.
  std::vector<std::uint32_t> list(size, kNone), next(size, kNone), slot_of(size, 0);
  std::vector<std::size_t> at(size, 0);
  const auto enlist = [&](std::uint32_t k) {
    if (at[k] < begin_[k + 1]) {
      next[k] = list[rows_[at[k]]];
      list[rows_[at[k]]] = k;
    }
  };
  for (std::uint32_t j = 0; j < size; ++j) {
    cancel.check();
    for (std::size_t s = begin_[j]; s < begin_[j + 1]; ++s) slot_of[rows_[s]] = static_cast<std::uint32_t>(s);
    for (std::uint32_t k = list[j]; k != kNone;) {
      const std::uint32_t after = next[k];
      const std::size_t own = at[k];
      const Block transposed = blocks_[own].transpose();
      diagonal_[j].noalias() -= blocks_[own] * transposed;
      for (std::size_t s = own + 1; s < begin_[k + 1]; ++s) {
        blocks_[slot_of[rows_[s]]].noalias() -= blocks_[s] * transposed;
      }
      ++at[k];
      enlist(k);
      k = after;
    }
    const Eigen::LLT<Block> cholesky(diagonal_[j]);
    if (cholesky.info() != Eigen::Success) return false;
    diagonal_[j] = cholesky.matrixL();
    if (!diagonal_[j].allFinite()) return false;
    for (std::size_t s = begin_[j]; s < begin_[j + 1]; ++s) {
      const Block rows = blocks_[s].transpose();
      blocks_[s] = diagonal_[j].triangularView<Eigen::Lower>().solve(rows).transpose();
    }
    at[j] = begin_[j];
    enlist(j);
  }
  return true;
}

Eigen::MatrixXd SelectedInverse::solve(const Eigen::MatrixXd& b) const {
  const std::size_t size = diagonal_.size();
  const auto at = [](std::size_t block) { return static_cast<Eigen::Index>(6 * block); };
  Eigen::MatrixXd x(b.rows(), b.cols());
  if (b.cols() == 0) return x;  // Eigen's triangular solver takes an element's address
  for (std::size_t i = 0; i < size; ++i) x.middleRows<6>(at(position_[i])) = b.middleRows<6>(at(i));
  for (std::size_t j = 0; j < size; ++j) {
    const Eigen::MatrixXd solved = diagonal_[j].triangularView<Eigen::Lower>().solve(x.middleRows<6>(at(j)));
    x.middleRows<6>(at(j)) = solved;
    for (std::size_t s = begin_[j]; s < begin_[j + 1]; ++s) {
      x.middleRows<6>(at(rows_[s])).noalias() -= blocks_[s] * solved;
    }
  }
  for (std::size_t j = size; j-- > 0;) {
    Eigen::MatrixXd rest = x.middleRows<6>(at(j));
    for (std::size_t s = begin_[j]; s < begin_[j + 1]; ++s) {
      rest.noalias() -= blocks_[s].transpose() * x.middleRows<6>(at(rows_[s]));
    }
    x.middleRows<6>(at(j)) = diagonal_[j].triangularView<Eigen::Lower>().transpose().solve(rest);
  }
  Eigen::MatrixXd result(b.rows(), b.cols());
  for (std::size_t i = 0; i < size; ++i) result.middleRows<6>(at(i)) = x.middleRows<6>(at(position_[i]));
  return result;
}

void SelectedInverse::invert(const Cancel& cancel) {
  const std::size_t size = diagonal_.size();
  std::vector<std::uint32_t> local(size, kNone);  // of a row: its place in column j
  std::vector<Block> unit, sum;
  for (std::size_t j = size; j-- > 0;) {
    cancel.check();
    const std::size_t begin = begin_[j], count = begin_[j + 1] - begin;
    const Block inverse_factor = diagonal_[j].triangularView<Eigen::Lower>().solve(Block::Identity());
    unit.resize(count);
    sum.assign(count, Block::Zero());
    for (std::size_t a = 0; a < count; ++a) {
      unit[a].noalias() = blocks_[begin + a] * inverse_factor;
      local[rows_[begin + a]] = static_cast<std::uint32_t>(a);
    }
    for (std::size_t a = 0; a < count; ++a) {
      const std::uint32_t k = rows_[begin + a];
      sum[a].noalias() += diagonal_[k] * unit[a];
      for (std::size_t s = begin_[k]; s < begin_[k + 1]; ++s) {
        const std::uint32_t b = local[rows_[s]];
        if (b == kNone) continue;
        sum[b].noalias() += blocks_[s] * unit[a];
        sum[a].noalias() += blocks_[s].transpose() * unit[b];
      }
    }
    diagonal_[j].noalias() = inverse_factor.transpose() * inverse_factor;
    for (std::size_t a = 0; a < count; ++a) {
      diagonal_[j].noalias() += unit[a].transpose() * sum[a];
      blocks_[begin + a] = -sum[a];
      local[rows_[begin + a]] = kNone;
    }
    diagonal_[j] = (0.5 * (diagonal_[j] + diagonal_[j].transpose())).eval();
  }
}

bool SelectedInverse::find(std::size_t i, std::size_t j, Block& block) const {
  const std::uint32_t row = position_[i], column = position_[j];
  if (row == column) {
    block = diagonal_[row];
    return true;
  }
  const std::size_t found = row > column ? slot(row, column) : slot(column, row);
  if (found == rows_.size()) return false;
  block = blocks_[found];
  if (row < column) block.transposeInPlace();
  return true;
}

}  // namespace nadir
