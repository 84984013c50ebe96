#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/geometry/pose.hpp"

namespace flatbuffers {
class Verifier;
}

namespace cellmap {

namespace schema {
struct Pose;
}

/// The format version that this build writes and reads (FORMAT.md, "Versions").
constexpr std::uint16_t kFormatVersion = 1;

/// One kind of FlatBuffers file.
struct BufferKind {
  const char* name;        ///< in messages, for example "CELL"
  const char* identifier;  ///< four characters
  std::size_t max_bytes;
  bool (*verify)(flatbuffers::Verifier&);  ///< generated: identifier and structure of version 1
};

/// Throws Error{kTooLarge} over `kind.max_bytes`; `verify_buffer` asks it too.
void check_size(std::span<const std::byte> bytes, const BufferKind& kind);

/// True where bytes may be read through the generated accessors without copying them first.
bool is_aligned(std::span<const std::byte> bytes);

/// Makes untrusted, aligned bytes safe to read through the generated accessors: size, identifier,
/// version and structure are checked, values are not. Throws Error{kTooLarge}, {kCorruptData} or,
/// for another version, {kUnsupported}.
void verify_buffer(std::span<const std::byte> bytes, const BufferKind& kind,
                   std::size_t max_tables);

/// A copy of bytes of any alignment on which `verify_buffer` holds.
Bytes verified_copy(std::span<const std::byte> bytes, const BufferKind& kind,
                    std::size_t max_tables);

schema::Pose pose_to_wire(const Pose& T);

/// Reads the twelve doubles of a schema::Pose at any alignment. Throws Error{kCorruptData} where
/// they are no rigid transform; `name` says which pose.
Pose pose_from_wire(const schema::Pose* wire, const char* name);

}  // namespace cellmap
