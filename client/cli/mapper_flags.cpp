#include "client/cli/mapper_flags.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <filesystem>

#include "cellmap/scan/part_of_drive.hpp"

#ifdef CELLMAP_WITH_PCL
#include "cellmap/pcl/scan_file.hpp"
#endif
#ifdef CELLMAP_WITH_ROSBAG
#include "cellmap/rosbag/bag_drive.hpp"
#endif

namespace cellmap::cli {
namespace {

template <typename Value>
void assign(Value& target, const std::optional<Value>& value) {
  if (value) target = *value;
}

ScanFileReader pcl_reader() {
#ifdef CELLMAP_WITH_PCL
  return pcl_io::read_scan_file;
#else
  return {};
#endif
}

std::unique_ptr<ScanSource> open_bag(const DriveFlags& flags) {
#ifdef CELLMAP_WITH_ROSBAG
  return ros_bag::open_bag(flags.dataset, {flags.topic, flags.odometry_topic, flags.poses});
#else
  throw Error(ErrorCode::kUnsupported,
              flags.dataset +
                  ": this program reads no ROS bags: install librosbag-storage-dev "
                  "and build it again, or export the scans as .pcd");
#endif
}

}  // namespace

IngestOptions MapperFlags::ingest_options() const {
  IngestOptions result = options;
  if (no_bidirectional) result.bidirectional = false;
  if (no_loops) result.loop_closures = false;
  result.loop_acceptance = loop_acceptance_from(loop_acceptance);  // CLI11 has checked it
  result.fit = plane_fit_from(fit);                                // CLI11 has checked it too
  return result;
}

MapperOptions MapperFlags::mapper_options(int threads) const {
  const IngestOptions given = ingest_options();
  MapperOptions mapper;
  assign(mapper.cell_distance_m, given.cell_distance_m);
  assign(mapper.filter.min_range_m, given.min_range_m);
  assign(mapper.filter.max_range_m, given.max_range_m);
  assign(mapper.filter.vertical_angle_correction_deg, given.vertical_angle_correction_deg);
  assign(mapper.build.min_points, given.min_points);
  assign(mapper.build.max_range_gap_m, given.max_range_gap_m);
  assign(mapper.build.fit, given.fit);
  assign(mapper.bidirectional, given.bidirectional);
  assign(mapper.loop_closures, given.loop_closures);
  assign(mapper.loops.accept, given.loop_acceptance);
  mapper.build.threads = mapper.registration.threads = threads;
  mapper.loops.registration.threads = mapper.pose_graph.threads = threads;
  mapper.validate();
  return mapper;
}

LatticeSpec MapperFlags::lattice() const {
  LatticeSpec spec;
  assign(spec.size, lattice_size);
  return spec;
}

void add_mapper_flags(CLI::App& verb, MapperFlags& flags) {
  const std::string group = "Mapping";
  verb.add_option("--cell-distance", flags.options.cell_distance_m,
                  "A new CELL begins beyond this distance, metres [6]")
      ->group(group);
  verb.add_option("--min-range", flags.options.min_range_m, "Nearer points are dropped, metres [2]")
      ->group(group);
  verb.add_option("--max-range", flags.options.max_range_m,
                  "Farther points are dropped, metres [120]")
      ->group(group);
  verb.add_option("--angle-correction", flags.options.vertical_angle_correction_deg,
                  "Turns points up, degrees; KITTI needs 0.205 [0]")
      ->group(group);
  verb.add_option(
          "--lattice-size", flags.lattice_size,
          "Directions of the lattice of a map that is made [50000]; coarser suits sparse scans")
      ->check(CLI::Range(1000, 1'000'000))
      ->group(group);
  verb.add_option("--min-points", flags.options.min_points,
                  "Patches with fewer points keep no plane [6]")
      ->group(group);
  verb.add_option("--range-gap", flags.options.max_range_gap_m,
                  "A larger gap between ranges makes a patch invalid, metres [3]")
      ->group(group);
  verb.add_option(
          "--fit", flags.fit,
          "Plane fit: trimmed, ransac (the paper's) or streaming (a CELL is ready sooner after its "
          "last scan) [trimmed]")
      ->check(CLI::IsMember({"trimmed", "ransac", "streaming"}))
      ->group(group);
  verb.add_flag("--no-bidirectional", flags.no_bidirectional,
                "Tie neighbouring CELLs by odometry alone")
      ->group(group);
  verb.add_flag("--no-loops", flags.no_loops, "Look for no loop closures")->group(group);
  verb.add_option(
          "--loop-acceptance", flags.loop_acceptance,
          "Which loops are believed: scores (several must agree) or paper (inliers over all "
          "points >= 0.2 alone, for comparison) [scores]")
      ->check(CLI::IsMember({"scores", "paper"}))
      ->group(group);
}

PoseFrame DriveFlags::frame() const {
  if (pose_frame == "camera") return PoseFrame::kCamera;
  return pose_frame == "sensor" ? PoseFrame::kSensor : PoseFrame::kAuto;
}

std::unique_ptr<ScanSource> DriveFlags::open() const {
  const bool is_bag = std::filesystem::path(dataset).extension() == ".bag";
  if (!is_bag && !(topic.empty() && odometry_topic.empty())) {
    throw Error(ErrorCode::kInvalidArgument,
                dataset + ": --topic and --odometry-topic belong to a .bag");
  }
  auto drive = is_bag ? open_bag(*this) : open_dataset(dataset, {poses, frame(), pcl_reader()});
  if (first_scan == 0 && scans == 0) return drive;
  return part_of_drive(std::move(drive), first_scan, scans);
}

std::string DriveFlags::session_name() const {
  if (!session.empty()) return session;
  std::filesystem::path folder(dataset);
  if (!folder.has_filename()) folder = folder.parent_path();
  if (folder == "." || folder == "..") folder = std::filesystem::canonical(folder);
  if (folder.extension() == ".bag") folder.replace_extension();
  std::string name = folder.filename().string().substr(0, 64);
  std::replace_if(
      name.begin(), name.end(),
      [](unsigned char c) { return !std::isalnum(c) && c != '.' && c != '_' && c != '-'; }, '-');
  return name.empty() ? "drive" : name;
}

void add_drive_flags(CLI::App& verb, DriveFlags& flags) {
  verb.add_option(
          "DATASET", flags.dataset,
          "Folder of the drive: KITTI odometry, or .bin/.pcd/.ply scans with a trajectory; or a "
          "ROS 1 .bag")
      ->required();
  verb.add_option("--poses", flags.poses,
                  "Odometry, KITTI or TUM format (default: poses.txt of the folder, a bag's own)");
  verb.add_option("--topic", flags.topic,
                  "Of a bag's scans, sensor_msgs/PointCloud2 (default: the only one)");
  verb.add_option(
      "--odometry-topic", flags.odometry_topic,
      "Of a bag's odometry, nav_msgs/Odometry or geometry_msgs/PoseStamped (default: the "
      "only one)");
  verb.add_option(
          "--pose-frame", flags.pose_frame,
          "Frame of KITTI poses: auto, camera or sensor; auto takes camera for the folder's own "
          "poses.txt beside a calib.txt")
      ->check(CLI::IsMember({"auto", "camera", "sensor"}))
      ->capture_default_str();
  verb.add_option("--first-scan", flags.first_scan,
                  "Take the drive from this scan on, with odometry that begins there")
      ->capture_default_str();
  verb.add_option("--scans", flags.scans, "Take so many scans; 0: to the end")
      ->capture_default_str();
  verb.add_option(
      "--session", flags.session,
      "Name of this drive in the map (default: the folder's); the same name resumes it");
}

PointCloud read_scan(const std::string& file) {
  const std::string extension = std::filesystem::path(file).extension().string();
  if (extension == ".bin") return read_kitti_bin(file);
  const ScanFileReader reader = pcl_reader();
  if (reader && (extension == ".pcd" || extension == ".ply")) return reader(file);
  throw Error(ErrorCode::kUnsupported,
              "cannot read a scan from '" + file + "': expected a " +
                  (reader ? ".bin (KITTI), .pcd or .ply file"
                          : ".bin (KITTI) file; this build has no PCL, so no .pcd and .ply"));
}

}  // namespace cellmap::cli
