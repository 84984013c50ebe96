#pragma once

#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>

#include "cellmap/store/store.hpp"

namespace cellmap {

struct CopiedMap {
  std::uint64_t cells = 0;
  std::uint64_t stored_bytes = 0;  ///< of the CELLs, as kept
};

/// Copies a map with its history from one store to another, whatever their engines: every revision
/// can be read there as here, CELLs keep their bytes and ids. Jobs stay behind. The source may be
/// written meanwhile and is copied at one revision; the copy is seen whole or not at all. At the
/// end the bytes of every CELL are read back from the copy and compared by hash.
///
/// Throws Error{kNotFound} without such a map, {kAlreadyExists} where `to` has one of that name,
/// {kCorruptData} where the source's bytes are damaged or the copy's differ, {kUnsupported} for a
/// store that is no SQL database, {kCancelled}. O(map); holds the bytes of one CELL in memory, and
/// of a PostgreSQL source the other columns of one table.
CopiedMap copy_map(const Store& from, Store& to, const std::string& map,
                   const std::stop_token& stop = {},
                   const std::function<void(std::uint64_t cells, std::uint64_t of)>& progress = {});

}  // namespace cellmap
