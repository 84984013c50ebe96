#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "cellmap/codec/archive_layout.hpp"
#include "cellmap/core/stamp.hpp"
#include "cellmap/map/georeference.hpp"

namespace cellmap {

/// What a part of an archive behind its CELLs is; the format's numbers. All but the last are a
/// zstd frame of a FlatBuffers file.
enum class ArchiveSectionKind : std::uint8_t {
  kPoseGraph = 1,   ///< `encode_pose_graph`: poses and constraints when the archive was made
  kChanges = 2,     ///< `encode_changes`: what leads from there to the newest revision
  kCells = 3,       ///< `encode_archive_cells`
  kScans = 4,       ///< `encode_archive_scans`
  kSuperseded = 5,  ///< what an update left behind: nobody's, but its checksum is known
};
std::string_view to_string(ArchiveSectionKind kind);

struct ArchiveSection {
  ArchiveSectionKind kind = ArchiveSectionKind::kSuperseded;
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;  ///< unpadded
  std::uint64_t checksum = 0;
  bool operator==(const ArchiveSection&) const = default;

  std::uint64_t end() const { return aligned_up(offset + bytes); }
};

/// A drive, as `SessionInfo` describes it.
struct ArchiveSession {
  std::string name, robot, sensor, odometry_frame;
  Stamp started = 0;  ///< Unix time; 0: not said
  bool operator==(const ArchiveSession&) const = default;
};

/// What an archive holds, and where its sections are.
struct ArchiveFooter {
  std::string map;    ///< name of the map that was archived
  Stamp created = 0;  ///< of that map, Unix time
  LatticeSpec lattice;
  ArchiveEncoding encoding = ArchiveEncoding::kRaw;
  double bound_m = 0;  ///< compact: as `DecodedCell::bound_m`
  Revision revision = 0;
  std::uint64_t cells = 0;
  std::uint64_t planes = 0;
  std::uint64_t cell_bytes = 0;  ///< of all CELLs as `encode_cell` writes them
  std::uint64_t scans = 0;
  std::vector<ArchiveSession> sessions;
  std::optional<Georeference> georeference;
  std::vector<ArchiveSection> sections;  ///< by offset, one right behind the other
};

constexpr std::size_t kMaxArchiveFooterBytes = 64u << 20;
constexpr std::size_t kMaxArchiveSections = 4096;

/// schema/archive.fbs, identifier "CAFT". Deterministic. Throws Error{kCorruptData} for a footer
/// that `decode_archive_footer` would refuse.
Bytes encode_archive_footer(const ArchiveFooter& footer);

/// Trusts no byte: verifies, then checks the rules of FORMAT.md, "Footer". Throws
/// Error{kCorruptData}, {kUnsupported}, {kTooLarge}.
ArchiveFooter decode_archive_footer(std::span<const std::byte> bytes);

}  // namespace cellmap
