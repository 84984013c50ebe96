#pragma once

#include <string>

#include "cellmap/cell/cell.hpp"
#include "cellmap/core/hash.hpp"

namespace cellmap {

/// Everything in a CELL as one JSON object for people, scripts and tests (FORMAT.md, "JSON form"):
/// hash, lattice {kind, size}, session, sequence, T_odom_cell as [x, y, z, qx, qy, qz, qw],
/// first_stamp and last_stamp in nanoseconds, first_scan, scan_count, statistics, indices, planes
/// as [distance_m, nx, ny, nz] each. One way: CELLs travel as FlatBuffers. Numbers have the fewest
/// digits that read back to the same float32, float64 or integer. `hash` is that of the bytes the
/// CELL came in.
std::string cell_to_json(const Cell& cell, const ContentHash& hash);

/// The same with the hash of `encode_cell(cell)`.
std::string cell_to_json(const Cell& cell);

}  // namespace cellmap
