#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>

#include "cellmap/cell/cell.hpp"

namespace cellmap {

/// The patches of a map as a mesh of hexagons (cell/patch_outline.hpp): binary little-endian PLY,
/// six vertices a patch with the patch's normal, then a face a patch. Written while CELLs come; the
/// faces follow at the end, since which vertices they join is known from their number. The file has
/// ".part" behind its name until it is finished. One owner.
class DiscFileWriter {
 public:
  explicit DiscFileWriter(const std::filesystem::path& file);
  ~DiscFileWriter();
  DiscFileWriter(const DiscFileWriter&) = delete;
  DiscFileWriter& operator=(const DiscFileWriter&) = delete;

  /// Throws Error{kIo}; {kTooLarge} above 357,913,941 patches, whose vertices an int cannot number.
  void add(const Cell& cell, const Lattice& lattice, const Pose& T_map_cell);
  void finish();

  std::uint64_t discs() const { return discs_; }

 private:
  std::filesystem::path file_, part_;
  std::ofstream out_;
  std::uint64_t discs_ = 0;
  bool finished_ = false;
};

}  // namespace cellmap
