#include "cellmap/export/disc_file.hpp"

#include <limits>
#include <string>

#include "cellmap/cell/patch_outline.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kHeaderBytes = 512;

/// Always of the same length.
std::string header_of(std::uint64_t discs) {
  std::string header =
      "ply\nformat binary_little_endian 1.0\ncomment CELLmap, map frame, metres\n"
      "element vertex " +
      std::to_string(kOutlineCorners * discs) +
      "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n"
      "property float ny\nproperty float nz\nelement face " +
      std::to_string(discs) + "\nproperty list uchar int vertex_indices\ncomment ";
  const std::string end = "\nend_header\n";
  header.append(kHeaderBytes - header.size() - end.size(), '.');
  return header + end;
}

void put(std::string& bytes, const Eigen::Vector3d& v) {
  const Eigen::Vector3f values = v.cast<float>();
  bytes.append(reinterpret_cast<const char*>(values.data()), sizeof(values));
}

}  // namespace

DiscFileWriter::DiscFileWriter(const fs::path& file) : file_(file), part_(file.string() + ".part") {
  out_.open(part_, std::ios::binary | std::ios::trunc);
  out_ << header_of(0);
  if (!out_) throw Error(ErrorCode::kIo, part_.string() + ": cannot be written");
}

DiscFileWriter::~DiscFileWriter() {
  if (finished_) return;
  out_.close();
  std::error_code ignored;
  fs::remove(part_, ignored);
}

void DiscFileWriter::add(const Cell& cell, const Lattice& lattice, const Pose& T_map_cell) {
  std::string rows;
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    const Plane& plane = cell.planes[k];
    const std::uint32_t index = cell.indices[k];
    const Eigen::Vector3d normal =
        T_map_cell.linear() * Eigen::Vector3d(plane.nx, plane.ny, plane.nz);
    for (const Eigen::Vector3d& corner :
         patch_outline(plane, lattice.direction(index), lattice.patch_radius_rad(index))) {
      put(rows, T_map_cell * corner);
      put(rows, normal);
    }
  }
  discs_ += cell.planes.size();
  if (kOutlineCorners * discs_ > std::numeric_limits<std::int32_t>::max()) {
    throw Error(ErrorCode::kTooLarge, "PLY numbers 2,147,483,647 vertices; export sessions apart");
  }
  out_.write(rows.data(), static_cast<std::streamsize>(rows.size()));
  if (!out_) throw Error(ErrorCode::kIo, part_.string() + ": cannot be written; is there space?");
}

void DiscFileWriter::finish() {
  std::int32_t vertex = 0;
  for (std::uint64_t k = 0; k < discs_; ++k) {
    std::string face(1, static_cast<char>(kOutlineCorners));
    for (std::size_t c = 0; c < kOutlineCorners; ++c, ++vertex) {
      face.append(reinterpret_cast<const char*>(&vertex), sizeof(vertex));
    }
    out_ << face;
  }
  out_.seekp(0);
  out_ << header_of(discs_);
  out_.close();
  std::error_code failed;
  if (out_) fs::rename(part_, file_, failed);
  if (!out_ || failed) throw Error(ErrorCode::kIo, file_.string() + ": cannot be written");
  finished_ = true;
}

}  // namespace cellmap
