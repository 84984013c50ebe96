#pragma once

#include <string>

#include "cellmap/cell/cell.hpp"

namespace cellmap::bench {

/// A CELL in the same FlatBuffers schema, written as one would at first: element by element into
/// vectors, from those into a growing builder, copied out. No hash, no check of a value.
std::string naive_encode(const Cell& cell);

/// FlatBuffers' verifier, then element by element into growing vectors. Throws std::runtime_error.
Cell naive_decode(const std::string& bytes);

/// zstd at its default level through strings.
std::string naive_compress(const std::string& bytes);
std::string naive_decompress(const std::string& frame);

}  // namespace cellmap::bench
