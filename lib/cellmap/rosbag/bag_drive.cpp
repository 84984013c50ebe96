#include "cellmap/rosbag/bag_drive.hpp"

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/rosbag/bag_file.hpp"
#include "cellmap/rosbag/messages.hpp"

namespace cellmap::ros_bag {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxMessages = 1u << 24;
constexpr const char* kCloudType = "sensor_msgs/PointCloud2";
constexpr const char* kOdometryType = "nav_msgs/Odometry";
constexpr const char* kPoseType = "geometry_msgs/PoseStamped";

struct ScanEntry {
  Stamp stamp = 0;
  MessagePlace place;
};

/// What one pass over the bag tells of a topic.
struct Topic {
  std::string type;
  std::string frame;  ///< of scans: the sensor's; of odometry: whose it is
  std::vector<ScanEntry> scans;
  std::vector<StampedPose> poses;
};

using Topics = std::map<std::string, Topic>;

Topics read_topics(BagFile& bag, const fs::path& file, bool with_poses) {
  Topics topics;
  std::size_t messages = 0;
  bag.for_each_message(
      [&](const Connection& sender, MessagePlace place, std::span<const std::byte> message) {
        const bool is_cloud = sender.type == kCloudType, is_odometry = sender.type == kOdometryType;
        const bool is_pose = with_poses && (is_odometry || sender.type == kPoseType);
        if (!is_cloud && !is_pose) return;
        if (++messages > kMaxMessages) {
          throw Error(ErrorCode::kTooLarge, "it has more than 16,777,216 scans and poses");
        }
        Topic& topic = topics[sender.topic];
        topic.type = sender.type;
        if (is_cloud) {
          const CloudMessage head = read_header(message);
          topic.frame = head.frame;
          topic.scans.push_back({head.stamp, place});
        } else {
          const PoseMessage pose = read_pose(message, is_odometry);
          topic.frame = pose.child_frame;
          topic.poses.push_back(pose.pose);
        }
      });
  if (topics.empty()) {
    throw Error(ErrorCode::kNotFound,
                file.string() + ": expected messages of " + kCloudType + ", found none");
  }
  return topics;
}

/// The topic that was asked for, or the only one that has what is looked for.
const Topic& choose(const Topics& topics, const fs::path& file, const std::string& asked,
                    const std::string& what, bool (*fits)(const Topic&)) {
  std::string names;
  const Topic* only = nullptr;
  std::size_t count = 0;
  for (const auto& [name, topic] : topics) {
    if (!fits(topic)) continue;
    if (name == asked) return topic;
    names += (names.empty() ? "" : ", ") + name;
    only = &topic;
    ++count;
  }
  if (asked.empty() && count == 1) return *only;
  const std::string found = names.empty() ? "none" : names;
  if (!asked.empty() || count == 0) {
    throw Error(ErrorCode::kNotFound, file.string() + ": expected " + what +
                                          (asked.empty() ? "" : " on " + asked) + ", found " +
                                          found);
  }
  throw Error(ErrorCode::kInvalidArgument, file.string() + ": expected one topic of " + what +
                                               ", found " + found + ": name the one that is meant");
}

std::string without_slash(const std::string& frame) {
  return frame.starts_with('/') ? frame.substr(1) : frame;
}

template <typename Stamped>
void sort_by_time(std::vector<Stamped>& entries) {
  std::ranges::stable_sort(entries, {}, &Stamped::stamp);
  const auto is_same = [](const Stamped& a, const Stamped& b) { return a.stamp == b.stamp; };
  entries.erase(std::unique(entries.begin(), entries.end(), is_same), entries.end());
}

Trajectory odometry_of(const Topics& topics, const fs::path& file, const BagOptions& options,
                       const std::string& sensor_frame) {
  if (!options.poses.empty()) return read_tum_trajectory(options.poses);
  const Topic& topic =
      choose(topics, file, options.odometry_topic,
             std::string(kOdometryType) + " or " + kPoseType + " (or a file with poses)",
             [](const Topic& one) { return !one.poses.empty(); });
  const std::string whose = without_slash(topic.frame), sensor = without_slash(sensor_frame);
  if (!whose.empty() && whose != sensor) {
    throw Error(ErrorCode::kInvalidArgument,
                file.string() + ": expected odometry of the sensor's frame \"" + sensor +
                    "\", found that of \"" + whose +
                    "\": give a TUM file with the poses of the sensor");
  }
  auto poses = topic.poses;
  sort_by_time(poses);
  return Trajectory(std::move(poses));
}

class BagDrive final : public ScanSource {
 public:
  BagDrive(const fs::path& file, const BagOptions& options) : file_(file), bag_(file) {
    const Topics topics = read_topics(bag_, file, options.poses.empty());
    const Topic& clouds = choose(topics, file, options.points_topic, kCloudType,
                                 [](const Topic& one) { return !one.scans.empty(); });
    odometry_ = odometry_of(topics, file, options, clouds.frame);
    scans_ = clouds.scans;
    sort_by_time(scans_);
    std::erase_if(scans_, [&](const ScanEntry& scan) { return !odometry_.at(scan.stamp); });
    if (scans_.empty()) {
      throw Error(ErrorCode::kCorruptData,
                  file.string() + ": expected odometry at the times of the scans, found none");
    }
  }

  std::size_t size() const override { return scans_.size(); }

  std::optional<PosedScan> next() override {
    if (next_ == size()) return std::nullopt;
    const ScanEntry& entry = scans_[next_];
    PosedScan scan{next_, entry.stamp, *odometry_.at(entry.stamp), points_at(entry.place)};
    ++next_;
    return scan;
  }

  void seek(std::size_t index) override {
    if (index > size()) {
      throw Error(ErrorCode::kInvalidArgument, "cannot go to scan " + std::to_string(index) +
                                                   " of a drive of " + std::to_string(size()));
    }
    next_ = index;
  }

  const Trajectory& ground_truth() const override { return none_; }

 private:
  PointCloud points_at(MessagePlace place) try {
    PointCloud points = read_point_cloud2(bag_.message(place)).points;
    if (points.empty()) throw Error(ErrorCode::kCorruptData, "found no points");
    return points;
  } catch (const Error& error) {
    throw Error(error.code(),
                file_.string() + ": scan " + std::to_string(next_) + ": " + error.what());
  }

  fs::path file_;
  BagFile bag_;
  Trajectory odometry_, none_;
  std::vector<ScanEntry> scans_;
  std::size_t next_ = 0;
};

}  // namespace

std::unique_ptr<ScanSource> open_bag(const fs::path& file, const BagOptions& options) {
  return std::make_unique<BagDrive>(file, options);
}

}  // namespace cellmap::ros_bag
