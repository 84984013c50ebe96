#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "cellmap/codec/byte_planes.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/common_generated.h"

// Columns (FORMAT.md, "Columns") as vectors of bytes of a table. For the sources of this room only.

namespace cellmap {

using WireColumn = flatbuffers::Vector<std::uint8_t>;

inline flatbuffers::Offset<WireColumn> column_to_wire(flatbuffers::FlatBufferBuilder& builder,
                                                      std::span<const std::int64_t> values) {
  const Bytes bytes = encode_column(values);
  return builder.CreateVector(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
}

/// Allocates 8 * `count` bytes: the caller bounds `count`. Throws Error{kCorruptData}.
inline std::vector<std::int64_t> column_from_wire(const WireColumn& wire, std::size_t count,
                                                  const char* name) {
  if (count == 0) return {};
  return decode_column(std::as_bytes(std::span(wire.Data(), wire.size())), count, name);
}

/// A column of strictly increasing ids. It has a byte a row at least, but for id 0 alone, so what
/// is allocated for the columns beside it is bounded too. Throws Error{kCorruptData}.
inline std::vector<std::uint32_t> ids_of_column(const WireColumn& wire, std::size_t count,
                                                std::size_t max_count, const char* name) {
  const auto corrupt = [&](const std::string& what) {
    return Error(ErrorCode::kCorruptData,
                 std::string("the column of ids '") + name + "' is not valid: " + what);
  };
  if (count > max_count || count > wire.size() + 1u) {
    throw corrupt(std::to_string(count) + " rows in " + std::to_string(wire.size()) + " bytes");
  }
  std::vector<std::uint32_t> ids;
  std::int64_t last = -1;
  for (const std::int64_t id : column_from_wire(wire, count, name)) {
    if (id <= last || id > UINT32_MAX) throw corrupt("they do not increase from 0 to 4294967295");
    ids.push_back(static_cast<std::uint32_t>(id));
    last = id;
  }
  return ids;
}

}  // namespace cellmap
