#pragma once

#include <span>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// schema/pose_graph.fbs, identifier "CPGR". Deterministic.
Bytes encode_pose_graph(const PoseGraph& graph);

/// Verifies and validates (finite rigid poses, known kinds, constraints between known nodes).
/// Throws as `decode_cell` does.
PoseGraph decode_pose_graph(std::span<const std::byte> bytes);

}  // namespace cellmap
