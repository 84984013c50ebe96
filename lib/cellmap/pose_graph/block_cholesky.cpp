#include "cellmap/pose_graph/block_cholesky.hpp"

#include <Eigen/Cholesky>
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>

namespace cellmap {
namespace {

/// place[unknown] in an order of elimination with little fill.
std::vector<std::uint32_t> elimination_places(std::size_t unknowns,
                                              std::span<const BlockCholesky::Pair> pairs) {
  const auto size = static_cast<Eigen::Index>(unknowns);
  std::vector<Eigen::Triplet<double>> entries;
  for (std::size_t i = 0; i < unknowns; ++i) {
    entries.emplace_back(static_cast<int>(i), static_cast<int>(i), 1.0);
  }
  for (const auto& [a, b] : pairs) {
    entries.emplace_back(static_cast<int>(a), static_cast<int>(b), 1.0);
    entries.emplace_back(static_cast<int>(b), static_cast<int>(a), 1.0);
  }
  Eigen::SparseMatrix<double> pattern(size, size);
  pattern.setFromTriplets(entries.begin(), entries.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
  Eigen::AMDOrdering<int>()(pattern, order);
  std::vector<std::uint32_t> places(unknowns);
  for (std::size_t i = 0; i < unknowns; ++i) {
    places[static_cast<std::size_t>(order.indices()[static_cast<Eigen::Index>(i)])] =
        static_cast<std::uint32_t>(i);
  }
  return places;
}

void sort_unique(std::vector<std::uint32_t>& values) {
  std::sort(values.begin(), values.end());
  values.erase(std::unique(values.begin(), values.end()), values.end());
}

}  // namespace

BlockCholesky::BlockCholesky(std::size_t unknowns, std::span<const Pair> pairs)
    : place_(elimination_places(unknowns, pairs)),
      inverse_diagonal_(unknowns),
      waiting_(unknowns),
      next_(unknowns),
      slot_in_column_(unknowns) {
  std::vector<std::vector<std::uint32_t>> below(unknowns);  // rows under the diagonal, by column
  for (const auto& [a, b] : pairs) {
    const auto [column, row] = std::minmax(place_[a], place_[b]);
    below[column].push_back(row);
  }
  find_pattern(below);
  for (const auto& [a, b] : pairs) {
    const auto [column, row] = std::minmax(place_[a], place_[b]);
    pair_slots_.push_back({slot_of(row, column), place_[a] < place_[b]});
  }
  matrix_.assign(rows_.size(), Matrix6d::Zero());
  factor_.resize(rows_.size());
}

/// A column of the factor has the rows of its column of the matrix and those of every column whose
/// first row below the diagonal it is (its children in the elimination tree).
void BlockCholesky::find_pattern(const std::vector<std::vector<std::uint32_t>>& below) {
  std::vector<std::vector<std::uint32_t>> columns = below;
  begin_.push_back(0);
  for (std::size_t j = 0; j < columns.size(); ++j) {
    sort_unique(columns[j]);
    rows_.push_back(static_cast<std::uint32_t>(j));
    rows_.insert(rows_.end(), columns[j].begin(), columns[j].end());
    begin_.push_back(rows_.size());
    if (columns[j].empty()) continue;
    std::vector<std::uint32_t>& parent = columns[columns[j].front()];
    parent.insert(parent.end(), columns[j].begin() + 1, columns[j].end());
    std::vector<std::uint32_t>().swap(columns[j]);
  }
}

std::size_t BlockCholesky::slot_of(std::size_t row, std::size_t column) const {
  const auto first = rows_.begin() + static_cast<std::ptrdiff_t>(begin_[column]);
  const auto last = rows_.begin() + static_cast<std::ptrdiff_t>(begin_[column + 1]);
  return static_cast<std::size_t>(std::lower_bound(first, last, row) - rows_.begin());
}

void BlockCholesky::set_zero() { std::fill(matrix_.begin(), matrix_.end(), Matrix6d::Zero()); }

void BlockCholesky::add_diagonal(std::size_t unknown, const Matrix6d& block) {
  matrix_[begin_[place_[unknown]]] += block;
}

void BlockCholesky::add_pair(std::size_t pair, const Matrix6d& block) {
  const auto [slot, transposed] = pair_slots_[pair];
  if (transposed) {
    matrix_[slot] += block.transpose();
  } else {
    matrix_[slot] += block;
  }
}

bool BlockCholesky::factorise(double damping) {
  factor_ = matrix_;
  for (auto& columns : waiting_) columns.clear();
  for (std::size_t column = 0; column < place_.size(); ++column) {
    factor_[begin_[column]].diagonal() *= 1.0 + damping;
    subtract_earlier_columns(column);
    if (!finish_column(column)) return false;
  }
  return true;
}

/// Left-looking: column j -= sum over k < j of column k times the transpose of block (j, k).
void BlockCholesky::subtract_earlier_columns(std::size_t column) {
  for (std::size_t slot = begin_[column]; slot < begin_[column + 1]; ++slot) {
    slot_in_column_[rows_[slot]] = slot;
  }
  for (const std::uint32_t earlier : waiting_[column]) {
    const std::size_t own = next_[earlier], end = begin_[earlier + 1];
    const Matrix6d multiplier = factor_[own].transpose();
    for (std::size_t slot = own; slot < end; ++slot) {
      factor_[slot_in_column_[rows_[slot]]].noalias() -= factor_[slot] * multiplier;
    }
    if (own + 1 == end) continue;
    next_[earlier] = own + 1;
    waiting_[rows_[own + 1]].push_back(earlier);
  }
}

bool BlockCholesky::finish_column(std::size_t column) {
  const std::size_t diagonal = begin_[column], end = begin_[column + 1];
  const Eigen::LLT<Matrix6d> llt(factor_[diagonal]);
  if (llt.info() != Eigen::Success || !factor_[diagonal].allFinite()) return false;
  inverse_diagonal_[column] = llt.matrixL().solve(Matrix6d::Identity());
  const Matrix6d right = inverse_diagonal_[column].transpose();
  for (std::size_t slot = diagonal + 1; slot < end; ++slot) factor_[slot] *= right;
  if (diagonal + 1 < end) {
    next_[column] = diagonal + 1;
    waiting_[rows_[diagonal + 1]].push_back(static_cast<std::uint32_t>(column));
  }
  return true;
}

Eigen::VectorXd BlockCholesky::solve(const Eigen::VectorXd& b) const {
  const std::size_t unknowns = place_.size();
  std::vector<Tangent> x(unknowns);
  for (std::size_t i = 0; i < unknowns; ++i) {
    x[place_[i]] = b.segment<6>(6 * static_cast<Eigen::Index>(i));
  }
  for (std::size_t j = 0; j < unknowns; ++j) {
    x[j] = inverse_diagonal_[j] * x[j];
    for (std::size_t slot = begin_[j] + 1; slot < begin_[j + 1]; ++slot) {
      x[rows_[slot]].noalias() -= factor_[slot] * x[j];
    }
  }
  for (std::size_t j = unknowns; j-- > 0;) {
    for (std::size_t slot = begin_[j] + 1; slot < begin_[j + 1]; ++slot) {
      x[j].noalias() -= factor_[slot].transpose() * x[rows_[slot]];
    }
    x[j] = inverse_diagonal_[j].transpose() * x[j];
  }
  Eigen::VectorXd result(b.size());
  for (std::size_t i = 0; i < unknowns; ++i) {
    result.segment<6>(6 * static_cast<Eigen::Index>(i)) = x[place_[i]];
  }
  return result;
}

}  // namespace cellmap
