#pragma once

#include <optional>
#include <string>

#include "cellmap/client/resources.hpp"
#include "cellmap/pipeline/mapper.hpp"

namespace CLI {
class App;
}

namespace cellmap::cli {

/// How a drive becomes a map: the same flags for `build`, which maps here, and `ingest`, where the
/// server does. What is not given keeps the default of `MapperOptions` or of the server.
struct MapperFlags {
  IngestOptions options;
  std::optional<std::uint32_t> lattice_size;
  bool no_bidirectional = false, no_loops = false;
  std::string fit, loop_acceptance;

  IngestOptions ingest_options() const;
  MapperOptions mapper_options(int threads) const;
  LatticeSpec lattice() const;
};

void add_mapper_flags(CLI::App& verb, MapperFlags& flags);

/// Which drive, and in which frame its poses are: shared by `build` and `ingest`.
struct DriveFlags {
  std::string dataset, poses, pose_frame = "auto", session;
  std::string topic, odometry_topic;      ///< of a bag
  std::size_t first_scan = 0, scans = 0;  ///< a part of the drive

  PoseFrame frame() const;
  /// Opens it on this machine (PCD and PLY where built with PCL).
  std::unique_ptr<ScanSource> open() const;
  /// The session's name: as given, else the folder's with odd characters replaced by '-'.
  std::string session_name() const;
};

void add_drive_flags(CLI::App& verb, DriveFlags& flags);

/// Reads one .bin, .pcd or .ply scan. Throws Error{kUnsupported} for others, and for PCD and PLY
/// where built without PCL.
PointCloud read_scan(const std::string& file);

}  // namespace cellmap::cli
