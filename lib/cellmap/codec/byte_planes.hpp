#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"

namespace cellmap {

/// A column of integers that change smoothly from row to row, for zstd (FORMAT.md, "Columns"):
/// what is left of each after its two neighbours before it were continued in a straight line, with
/// the sign in the lowest bit, all lowest bytes first, then all second bytes, and so on for as many
/// bytes as the largest needs. Arithmetic is modulo 2^64, so every column comes back as it was.
Bytes encode_column(std::span<const std::int64_t> values);

/// Inverse of `encode_column` for a column of `count` >= 1 rows. Throws Error{kCorruptData} where
/// `bytes` is not 0 to 8 times as long; `name` says which column. Allocates 8 * `count` bytes: the
/// caller bounds `count`.
std::vector<std::int64_t> decode_column(std::span<const std::byte> bytes, std::size_t count,
                                        const char* name);

}  // namespace cellmap
