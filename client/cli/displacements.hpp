#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/codec/plane_displacement.hpp"
#include "cellmap/core/hash.hpp"

namespace cellmap::cli {

/// How far the CELLs of an archive or a store are from those that they were coded from.
struct Displacements {
  std::vector<CellDisplacement> cells;
  std::uint64_t equal = 0;      ///< CELLs with every bit of their source's
  std::uint64_t different = 0;  ///< CELLs that are not of the source at all
  double bound_m = 0;           ///< the widest
  bool is_bound_kept = true;

  /// `source_hash`: of the CELL that `cell` says it was coded from; `cell_bound_m` 0: every bit.
  void add(const Cell& cell, const ContentHash& source_hash, double cell_bound_m,
           const Cell& source);

  double worst_m() const;
  /// The median over CELLs of a figure that each has over its planes.
  double median(double CellDisplacement::*figure) const;
};

nlohmann::json to_json(const Displacements& found);
std::string to_text(const Displacements& found);

/// Throws Error{kCorruptData} where a CELL is not of the source or a bound is broken; `what`: "the
/// archive".
void require_kept(const Displacements& found, const std::string& what);

}  // namespace cellmap::cli
