#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "cellmap/core/progress.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "cellmap/scan/trajectory.hpp"

namespace cellmap {

/// A spinning LiDAR. Defaults: HDL-64E-like, 64 beams from +2 to -24.8 deg, 10 Hz, about 2,083
/// columns a turn (133k rays, about 120k returns).
struct LidarModel {
  std::string name = "hdl64e";
  int beams = 64;
  double top_elevation_deg = 2.0, bottom_elevation_deg = -24.8;
  int columns = 2083;
  double rate_hz = 10.0;
  double max_range_m = 120.0;
  double range_noise_m = 0.02;  ///< standard deviation
  /// Power falls with the square of the range and with the cosine c of the angle of incidence:
  /// nothing returns from beyond grazing_range_m * sqrt(c). 350 m lets the ground be seen to 60 m,
  /// as real recordings do; 0 switches it off.
  double grazing_range_m = 350.0;
  double drop_out = 0.05;  ///< share of returns lost at random
  double mount_height_m = 1.73;

  /// "hdl64e", "os1-64", "vlp16"; Error{kInvalidArgument} lists them.
  static LidarModel by_name(const std::string& name);
  void validate() const;
};

struct SimulatorOptions {
  /// "town": generated, about 1 km with loops; "city": the same of 3.7 km; else a trajectory file
  /// (KITTI camera or sensor frame, see `route_frame`; or TUM).
  std::string route = "town";
  PoseFrame route_frame = PoseFrame::kAuto;
  std::size_t scans = 0;  ///< 0: the whole route
  /// One scan each this many metres of the way; 0: at the LiDAR's rate, or one a row of the file.
  double spacing_m = 0;
  std::uint64_t seed = 1;          ///< world, noise and drift
  std::string odometry = "drift";  ///< "truth", "drift" (seeded model), or a trajectory file
                                   ///< estimated on the same route, row for row
  LidarModel lidar;
  int threads = 1;
  /// Lateral offset of the driven line from the route, to the left [m]: another lane; -2 to 4, the
  /// strip that is kept free of standing things. The town does not depend on it.
  double lateral_offset_m = 0;
  /// Seed of moved and parked cars, so that another day has the same town but other cars and, like
  /// another lane, noise of its own. 0: `seed`.
  std::uint64_t traffic_seed = 0;
  /// The sensor is turned this far to the left of where its vehicle drives: at 180 it sees what a
  /// drive in the opposite direction sees.
  double heading_deg = 0;
  /// Each scan is taken leaning by up to this about a horizontal axis, both drawn at random; 0 to
  /// 30.
  double lean_deg = 0;

  void validate() const;
};

/// A deterministic synthetic town along a route, seen by a simulated LiDAR. The same options give
/// the same bytes for any thread count, and scan i the same bytes whether reached by `next` or
/// `seek`. Figures from it are simulated figures.
///
/// World frame: z up; the town's route starts within a few centimetres of the identity, a file's
/// where the file says. The sensor is `mount_height_m` above the ground, with the roll, pitch and
/// yaw of the route; where passes of one place disagree in height they are reconciled, so that
/// `ground_truth` may differ in z from the file (an estimate is moved with it and keeps its error).
/// A scan is instantaneous: it has no sweep distortion, and moving cars stand still in it. Points
/// are ordered beam by beam from the top. A route file gives one scan a row, at the row's stamp.
///
/// Streams: memory holds the route's poses, the town's plan (about 100 B an object) and the
/// triangles within reach of the sensor, which do not grow with the route.
/// Throws Error{kInvalidArgument} or {kNotFound} for options, and what reading a trajectory throws.
std::unique_ptr<ScanSource> simulate(const SimulatorOptions& options);

/// Writes any source as a KITTI-layout folder: velodyne/NNNNNN.bin, times.txt, poses.txt (odometry)
/// and poses_gt.txt (truth, where there is one), both KITTI rows in the sensor frame (no
/// calib.txt). Throws Error{kAlreadyExists} where `folder` holds scans, times or poses already,
/// {kCancelled}, {kIo}; whatever it wrote is removed again when it throws.
void write_dataset(ScanSource& source, const std::filesystem::path& folder,
                   const std::stop_token& stop = {}, const ProgressCallback& progress = {});

}  // namespace cellmap
