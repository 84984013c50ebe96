#pragma once

#include <span>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/geometry/triangle_mesh.hpp"

namespace cellmap {

/// Little-endian numbers of any kind, appended as they lie in memory.
template <typename Number>
void append_number(Bytes& bytes, Number value) {
  const auto* first = reinterpret_cast<const std::byte*>(&value);
  bytes.insert(bytes.end(), first, first + sizeof(value));
}

/// A binary PCD 0.7 file of x, y and z as float.
Bytes pcd_bytes(const PointCloud& points);

/// The points of `pcd_bytes`. Reads no other PCD; throws Error{kCorruptData}.
PointCloud points_of_pcd(std::span<const std::byte> bytes);

/// A binary little-endian PLY file: vertices of three floats, triangles as lists of three ints.
Bytes ply_bytes(const TriangleMesh& mesh);

/// The mesh of `ply_bytes`. Reads no other PLY; throws Error{kCorruptData}.
TriangleMesh mesh_of_ply(std::span<const std::byte> bytes);

}  // namespace cellmap
