#pragma once

#include <cstdint>
#include <span>

namespace cellmap {

/// SQL that leads from version k of the schema to version k + 1, in the words of SQLite. Published
/// steps never change.
std::span<const char* const> sql_schema_steps();

/// Side of the square ground-plane grid by which CELLs are found, m.
constexpr double kGridSizeM = 64.0;

/// Column of the grid that holds a coordinate; monotonic, bounded for any finite coordinate.
std::int64_t grid_key(double coordinate_m);

}  // namespace cellmap
