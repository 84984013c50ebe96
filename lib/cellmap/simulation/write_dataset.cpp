#include <array>
#include <bit>
#include <cstdio>
#include <fstream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/simulation/simulator.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;

static_assert(std::endian::native == std::endian::little, "KITTI files are little-endian");

/// A KITTI name has six digits.
constexpr std::size_t kMaxScans = 1'000'000;

/// Removes what was written so far unless `keep` was called: a stopped run leaves no half data set
/// behind that would refuse the next one.
class WrittenFiles {
 public:
  ~WrittenFiles() {
    if (kept_) return;
    std::error_code ignored;
    for (const fs::path& file : files_) fs::remove(file, ignored);
    for (auto folder = folders_.rbegin(); folder != folders_.rend(); ++folder) {
      fs::remove(*folder, ignored);
    }
  }
  void create_folders(const fs::path& folder) {
    if (folder.empty() || fs::exists(folder)) return;
    create_folders(folder.parent_path());
    std::error_code failure;
    fs::create_directory(folder, failure);
    if (failure) {
      throw Error(ErrorCode::kIo,
                  "cannot create the folder " + folder.string() + ": " + failure.message());
    }
    folders_.push_back(folder);
  }
  void write(const fs::path& file, const char* bytes, std::size_t size) {
    files_.push_back(file);
    std::ofstream out(file, std::ios::binary);
    out.write(bytes, static_cast<std::streamsize>(size));
    out.close();
    if (!out) throw Error(ErrorCode::kIo, "cannot write " + file.string() + ": is the disk full?");
  }
  void write(const fs::path& file, const std::string& text) {
    write(file, text.data(), text.size());
  }
  void keep() { kept_ = true; }

 private:
  std::vector<fs::path> files_, folders_;
  bool kept_ = false;
};

void refuse_to_overwrite(const fs::path& folder) {
  const fs::path scans = folder / "velodyne";
  if (fs::exists(scans) && !(fs::is_directory(scans) && fs::is_empty(scans))) {
    throw Error(ErrorCode::kAlreadyExists, "expected a folder without scans, found some in " +
                                               scans.string() + "; choose another folder");
  }
  for (const char* name : {"times.txt", "poses.txt", "poses_gt.txt", "calib.txt"}) {
    if (fs::exists(folder / name)) {
      throw Error(ErrorCode::kAlreadyExists, "expected a folder without a data set, found " +
                                                 (folder / name).string() +
                                                 "; choose another folder");
    }
  }
}

std::string numbered(const char* format, std::size_t number) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), format, number);
  return text.data();
}

void write_scan(WrittenFiles& files, const fs::path& file, const PointCloud& points) {
  std::vector<float> rows;
  rows.reserve(4 * points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    rows.insert(rows.end(), {points.x[i], points.y[i], points.z[i], 0.0f});
  }
  files.write(file, reinterpret_cast<const char*>(rows.data()), rows.size() * sizeof(float));
}

/// Seconds with all nine decimals of a stamp.
std::string time_row(Stamp stamp) {
  const Stamp second = 1'000'000'000;
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%s%lld.%09lld\n", stamp < 0 ? "-" : "",
                static_cast<long long>(std::abs(stamp / second)),
                static_cast<long long>(std::abs(stamp % second)));
  return text.data();
}

}  // namespace

void write_dataset(ScanSource& source, const fs::path& folder, const std::stop_token& stop,
                   const ProgressCallback& progress) {
  refuse_to_overwrite(folder);
  if (source.size() > kMaxScans) {
    throw Error(ErrorCode::kTooLarge, "expected at most 1,000,000 scans in a data set, found " +
                                          std::to_string(source.size()));
  }
  WrittenFiles files;
  files.create_folders(folder / "velodyne");
  std::string times;
  std::vector<StampedPose> odometry;
  source.seek(0);
  while (auto scan = source.next()) {
    throw_if_stopped(stop);
    write_scan(files, folder / "velodyne" / (numbered("%06zu", odometry.size()) + ".bin"),
               scan->points);
    times += time_row(scan->stamp);
    odometry.push_back({scan->stamp, scan->T_odom_sensor});
    if (progress) progress({odometry.size(), source.size(), 0});
  }
  files.write(folder / "times.txt", times);
  files.write(folder / "poses.txt",
              to_text(Trajectory(std::move(odometry)), TrajectoryFormat::kKitti));
  if (!source.ground_truth().empty()) {
    files.write(folder / "poses_gt.txt", to_text(source.ground_truth(), TrajectoryFormat::kKitti));
  }
  files.keep();
}

}  // namespace cellmap
