#pragma once

#include <span>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// Limit of an encoded pose graph: about a million CELLs with their constraints.
constexpr std::size_t kMaxPoseGraphBytes = 512u << 20;

/// schema/pose_graph.fbs, identifier "CPGR". Deterministic. Throws Error{kCorruptData} for a graph
/// that `decode_pose_graph` would refuse. Only the upper triangles of the (symmetric) information
/// matrices are written.
Bytes encode_pose_graph(const PoseGraph& graph);

/// Verifies and validates: finite rigid poses, increasing ids (constraints with id 0 are not
/// numbered yet and may stand anywhere), known kinds, constraints between known nodes that pass
/// `validate(constraint)`, scores in their ranges. Throws as `decode_cell` does.
PoseGraph decode_pose_graph(std::span<const std::byte> bytes);

}  // namespace cellmap
