#include "cellmap/evaluation/point_bytes.hpp"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <string>
#include <string_view>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kPointBytes = 3 * sizeof(float);

std::string header_of(std::size_t points) {
  const std::string count = std::to_string(points);
  return "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\n"
         "TYPE F F F\nCOUNT 1 1 1\nWIDTH " +
         count + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + count + "\nDATA binary\n";
}

std::string mesh_header(std::size_t vertices, std::size_t triangles) {
  return "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(vertices) +
         "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
         std::to_string(triangles) + "\nproperty list uchar int vertex_indices\nend_header\n";
}

constexpr std::size_t kTriangleBytes = 1 + 3 * sizeof(std::uint32_t);

/// The number behind `word` in a header; 0 where there is none.
std::size_t number_behind(std::string_view header, std::string_view word) {
  const std::size_t at = header.find(word);
  if (at == header.npos) return 0;
  return std::strtoull(std::string(header.substr(at + word.size(), 20)).c_str(), nullptr, 10);
}

}  // namespace

Bytes pcd_bytes(const PointCloud& points) {
  const std::string header = header_of(points.size());
  Bytes bytes(header.size() + points.size() * kPointBytes);
  std::memcpy(bytes.data(), header.data(), header.size());
  std::byte* out = bytes.data() + header.size();
  for (std::size_t i = 0; i < points.size(); ++i, out += kPointBytes) {
    const float xyz[] = {points.x[i], points.y[i], points.z[i]};
    std::memcpy(out, xyz, kPointBytes);
  }
  return bytes;
}

PointCloud points_of_pcd(std::span<const std::byte> bytes) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()),
                              std::min<std::size_t>(bytes.size(), 1024));
  constexpr std::string_view kEnd = "DATA binary\n";
  const std::size_t end = text.find(kEnd);
  const std::size_t begin = end + kEnd.size();
  const std::size_t count = end == text.npos ? 0 : (bytes.size() - begin) / kPointBytes;
  if (end == text.npos || text.substr(0, begin) != header_of(count) ||
      bytes.size() != begin + count * kPointBytes) {
    throw Error(ErrorCode::kCorruptData, "expected a binary PCD file of x, y and z");
  }
  PointCloud points;
  points.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    float xyz[3];
    std::memcpy(xyz, bytes.data() + begin + i * kPointBytes, kPointBytes);
    points.push_back({xyz[0], xyz[1], xyz[2]});
  }
  return points;
}

Bytes ply_bytes(const TriangleMesh& mesh) {
  const std::string header = mesh_header(mesh.vertices.size(), mesh.triangles.size());
  Bytes bytes(header.size() + mesh.vertices.size() * kPointBytes +
              mesh.triangles.size() * kTriangleBytes);
  std::memcpy(bytes.data(), header.data(), header.size());
  std::byte* out = bytes.data() + header.size();
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i, out += kPointBytes) {
    std::memcpy(out, mesh.vertices[i].data(), kPointBytes);
  }
  for (const auto& triangle : mesh.triangles) {
    *out = std::byte{3};
    std::memcpy(out + 1, triangle.data(), kTriangleBytes - 1);
    out += kTriangleBytes;
  }
  return bytes;
}

TriangleMesh mesh_of_ply(std::span<const std::byte> bytes) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()),
                              std::min<std::size_t>(bytes.size(), 1024));
  const std::size_t vertices = number_behind(text, "element vertex ");
  const std::size_t triangles = number_behind(text, "element face ");
  const std::string header = mesh_header(vertices, triangles);
  const bool sane = vertices <= bytes.size() && triangles <= bytes.size();
  if (!sane || !text.starts_with(header) ||
      bytes.size() != header.size() + vertices * kPointBytes + triangles * kTriangleBytes) {
    throw Error(ErrorCode::kCorruptData, "expected a binary PLY file of triangles");
  }
  TriangleMesh mesh;
  const std::byte* in = bytes.data() + header.size();
  for (std::size_t i = 0; i < vertices; ++i, in += kPointBytes) {
    Eigen::Vector3f vertex;
    std::memcpy(vertex.data(), in, kPointBytes);
    mesh.vertices.push_back(vertex);
  }
  for (std::size_t t = 0; t < triangles; ++t, in += kTriangleBytes) {
    std::array<std::uint32_t, 3> triangle;
    std::memcpy(triangle.data(), in + 1, kTriangleBytes - 1);
    const bool inside = std::max({triangle[0], triangle[1], triangle[2]}) < vertices;
    if (*in != std::byte{3} || !inside) {
      throw Error(ErrorCode::kCorruptData, "expected triangles between vertices of the file");
    }
    mesh.triangles.push_back(triangle);
  }
  return mesh;
}

}  // namespace cellmap
