#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "cellmap/geometry/pose.hpp"

namespace cellmap {

/// Cholesky factorisation of a sparse symmetric positive definite matrix of 6x6 blocks, one block
/// row for each unknown pose. Unknowns are eliminated in approximate minimum degree order, in which
/// a drive without loops costs one block each. Pattern and order are found once and serve every
/// factorisation. One thread at a time; the same bits on every run.
class BlockCholesky {
 public:
  using Pair = std::pair<std::size_t, std::size_t>;

  /// `pairs` are the coupled unknowns, first != second, in any order; repetitions are allowed.
  BlockCholesky(std::size_t unknowns, std::span<const Pair> pairs);

  void set_zero();
  void add_diagonal(std::size_t unknown, const Matrix6d& block);
  /// Adds to the block in row `first` and column `second` of pair number `pair`, and its transpose
  /// on the other side of the diagonal.
  void add_pair(std::size_t pair, const Matrix6d& block);

  /// Factorises the matrix with its diagonal multiplied by 1 + damping. False where it is not
  /// positive definite; the matrix stays either way.
  bool factorise(double damping);

  /// x of A * x = b, with 6 numbers for each unknown. After a `factorise` that was true.
  Eigen::VectorXd solve(const Eigen::VectorXd& b) const;

  /// Blocks of the factor, a measure of cost.
  std::size_t factor_blocks() const { return rows_.size(); }

 private:
  struct PairSlot {
    std::size_t slot;
    bool transposed;
  };

  void find_pattern(const std::vector<std::vector<std::uint32_t>>& below);
  std::size_t slot_of(std::size_t row, std::size_t column) const;
  void subtract_earlier_columns(std::size_t column);
  bool finish_column(std::size_t column);

  // Columns in order of elimination. Column j's blocks lie in [begin_[j], begin_[j + 1]), the
  // diagonal first, then by ascending row.
  std::vector<std::uint32_t> place_;  ///< of an unknown in the order of elimination
  std::vector<std::size_t> begin_;
  std::vector<std::uint32_t> rows_;
  std::vector<PairSlot> pair_slots_;
  std::vector<Matrix6d> matrix_, factor_;
  std::vector<Matrix6d> inverse_diagonal_;  ///< of the factor: lower triangles

  // While factorising: finished columns whose next block to use lies in a given row.
  std::vector<std::vector<std::uint32_t>> waiting_;
  std::vector<std::size_t> next_;
  std::vector<std::size_t> slot_in_column_;
};

}  // namespace cellmap
