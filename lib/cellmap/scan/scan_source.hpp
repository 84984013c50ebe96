#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "cellmap/geometry/pose.hpp"
#include "cellmap/scan/scan.hpp"
#include "cellmap/scan/trajectory.hpp"

namespace cellmap {

/// A scan of more points is refused: ten times what a 128-beam LiDAR gives a turn.
constexpr std::size_t kMaxScanPoints = 2'000'000;

/// A scan of a drive with the odometry pose it was taken at.
struct PosedScan {
  std::size_t index = 0;  ///< position in the drive, from 0
  Stamp stamp = 0;
  Pose T_odom_sensor = Pose::Identity();
  PointCloud points;  ///< sensor frame, unfiltered: may hold NaN and any range
};

/// A recorded or simulated drive, read one scan at a time: memory does not grow with its length.
/// Not thread safe.
class ScanSource {
 public:
  virtual ~ScanSource() = default;

  /// Number of scans in the drive.
  virtual std::size_t size() const = 0;

  /// The next scan, or nullopt at the end. Throws Error{kIo} or Error{kCorruptData} naming the
  /// file, what was expected and what was found.
  virtual std::optional<PosedScan> next() = 0;

  /// Makes `next` return scan `index` <= size().
  virtual void seek(std::size_t index) = 0;

  /// T_odom_sensor of every scan, where it is known before any is read; else empty.
  virtual std::span<const Pose> odometry() const { return {}; }

  /// Makes a `next` that waits on another thread, and every later one, throw Error{kCancelled}; the
  /// only function that may be called meanwhile. Sources that never wait for long ignore it.
  virtual void interrupt() {}

  /// Ground truth T_world_sensor where the drive carries it, one pose a scan with the scan's stamp;
  /// else empty.
  virtual const Trajectory& ground_truth() const = 0;
};

/// Reads one scan file into points; registered by extension so that PCL stays at the edge.
using ScanFileReader = std::function<PointCloud(const std::filesystem::path&)>;

/// In which frame a pose file gives its poses.
enum class PoseFrame {
  /// For the folder's own poses.txt and poses_gt.txt: camera where the folder has a calib.txt
  /// (which
  /// must then hold Tr), else sensor. For any other pose file: sensor.
  kAuto,
  kCamera,  ///< KITTI's left camera; T_sensor = Tr^-1 * T * Tr (calib.txt with Tr is required)
  kSensor,  ///< the LiDAR itself
};

struct DatasetOptions {
  /// Trajectory file; empty: poses.txt in the folder. A relative path is looked for in the folder
  /// first, then in the working directory. Whoever takes it from the network checks it first.
  std::filesystem::path poses;
  PoseFrame pose_frame = PoseFrame::kAuto;
  /// Reader for ".pcd" and ".ply" (cellmap::pcl_io::read_scan_file); empty: such folders are
  /// refused with Error{kUnsupported}. ".bin" (KITTI: little-endian float32 x, y, z, intensity) is
  /// built in.
  ScanFileReader pcl_reader;
};

/// Opens a recorded drive. Understands
/// - KITTI odometry folders: velodyne/NNNNNN.bin, times.txt, calib.txt (Tr), poses.txt;
/// - folders of .bin, .pcd or .ply scans (in velodyne/, in scans/ or in the folder itself; ordered
/// by
///   the number at the end of the name, or by name) with a KITTI- or TUM-format trajectory. KITTI
///   rows go by position; a TUM trajectory needs times.txt and is interpolated.
/// times.txt holds one time in seconds a line; without it scans are 0.1 s apart.
/// times.txt and a KITTI trajectory may have more rows than there are scans where the scans are
/// numbered 0, 1, 2, ... or carry no numbers (further rows are ignored); never fewer.
/// poses_gt.txt in the folder becomes `ground_truth`, read by the same rules. It is in the same
/// frame as poses.txt where the poses are the folder's own; else its frame is found as by kAuto.
/// Only names, times and poses are kept: some 200 bytes a scan. A file that cannot be read throws
/// from `next`, and `next` then tries it again; `seek` goes past it. `seek` beyond the end throws
/// Error{kInvalidArgument}.
/// Throws Error{kNotFound}, {kInvalidArgument}, {kUnsupported} or {kCorruptData} saying what was
/// expected and found.
std::unique_ptr<ScanSource> open_dataset(const std::filesystem::path& folder,
                                         const DatasetOptions& options = {});

/// Reads one KITTI .bin file, points as they are (NaN included). Throws Error{kNotFound}, {kIo},
/// {kTooLarge} over `kMaxScanPoints`, {kCorruptData} where it is empty or its length is not a
/// multiple of 16; every message begins with the file's name.
PointCloud read_kitti_bin(const std::filesystem::path& file);

/// The same from bytes in memory (an HTTP body); no bytes are no points. At most `max_points`,
/// else Error{kTooLarge}.
PointCloud parse_kitti_bin(std::span<const std::byte> bytes,
                           std::size_t max_points = kMaxScanPoints);

/// Writes (or overwrites) a KITTI .bin file with intensity 0. Throws Error{kInvalidArgument} where
/// there are no points or more than `kMaxScanPoints` (it could not be read back), {kIo}.
void write_kitti_bin(const std::filesystem::path& file, const PointCloud& points);

}  // namespace cellmap
