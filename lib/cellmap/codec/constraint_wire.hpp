#pragma once

#include <cstddef>

#include "cellmap/pose_graph/pose_graph.hpp"

// Constraints as pose graphs and changes carry them. For the sources of this room only.

namespace flatbuffers {
template <typename T>
struct Offset;
class FlatBufferBuilder;
}  // namespace flatbuffers

namespace cellmap {

namespace schema {
struct Constraint;
}

/// A constraint with storage of its own takes more bytes than this, so a buffer that needs more
/// tables repeats some of them to make its decoder allocate.
constexpr std::size_t kMinConstraintBytes = 256;

flatbuffers::Offset<schema::Constraint> constraint_to_wire(flatbuffers::FlatBufferBuilder& builder,
                                                           const Constraint& constraint);

/// Throws Error{kCorruptData} for a pose that is not rigid; the rest is for `check_constraint`.
Constraint constraint_from_wire(const schema::Constraint& wire);

/// The rules of FORMAT.md, "Pose graph", on one constraint, but that its ends are in the graph.
/// Throws Error{kCorruptData}, {kUnsupported} for a kind or origin that this build does not know.
void check_constraint(const Constraint& constraint);

/// Throws Error{kCorruptData} outside of [0, 1].
void check_weight(double weight);

}  // namespace cellmap
