#include "bench/loopy_graph.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "bench/drive.hpp"
#include "cellmap/pose_graph/information.hpp"
#include "cellmap/scan/trajectory.hpp"
#include "cellmap/simulation/random.hpp"

namespace cellmap::bench {
namespace {

constexpr double kNodeDistanceM = 6.0;
constexpr int kStepsABlock = 10;
constexpr int kBlocks = 60;
constexpr double kLoopDistanceM = 8.0;
constexpr std::size_t kMostLoops = 4, kLeastApart = 20;

CellId id_of(std::size_t position) { return {static_cast<std::uint32_t>(position + 1)}; }

Constraint measurement(const std::vector<Pose>& truth, std::size_t from, std::size_t to,
                       const PoseSigma& sigma, simulation::Random& random) {
  const auto normal3 = [&](double deviation) {
    const double x = random.normal(), y = random.normal(), z = random.normal();
    return Eigen::Vector3d(deviation * Eigen::Vector3d(x, y, z));
  };
  Tangent turn = Tangent::Zero();
  turn.tail<3>() = normal3(sigma.rotation_rad);
  const Pose T = truth[from].inverse() * truth[to];
  Constraint c;
  c.from = id_of(from);
  c.to = id_of(to);
  c.T_from_to.linear() = exp(turn).linear() * T.linear();
  c.T_from_to.translation() = T.translation() + normal3(sigma.translation_m);
  c.information = information_of(sigma, c.T_from_to);
  return c;
}

/// Earlier poses that may be loops, found by their square on the ground.
class EarlierPoses {
 public:
  void add(std::size_t index, const Eigen::Vector3d& p) { squares_[square(p)].push_back(index); }

  std::vector<std::size_t> near(std::size_t index, const std::vector<Pose>& truth) const {
    const Eigen::Vector3d p = truth[index].translation();
    const auto distance = [&](std::size_t i) { return (truth[i].translation() - p).norm(); };
    std::vector<std::size_t> found;
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dz = -1; dz <= 1; ++dz) {
        const auto entry = squares_.find({square(p).first + dx, square(p).second + dz});
        if (entry == squares_.end()) continue;
        for (const std::size_t i : entry->second) {
          if (i + kLeastApart < index && distance(i) < kLoopDistanceM) found.push_back(i);
        }
      }
    }
    std::sort(found.begin(), found.end(),
              [&](std::size_t a, std::size_t b) { return distance(a) < distance(b); });
    if (found.size() > kMostLoops) found.resize(kMostLoops);
    return found;
  }

 private:
  // x and z: the ground plane of KITTI's camera frame.
  static std::pair<int, int> square(const Eigen::Vector3d& p) {
    return {static_cast<int>(std::floor(p.x() / kLoopDistanceM)),
            static_cast<int>(std::floor(p.z() / kLoopDistanceM))};
  }
  std::map<std::pair<int, int>, std::vector<std::size_t>> squares_;
};

}  // namespace

std::vector<Pose> kitti00_cell_poses() {
  const auto file = kitti00_route();
  std::vector<Pose> poses;
  if (!std::filesystem::exists(file)) return poses;
  const Trajectory trajectory = read_kitti_trajectory(file);
  for (const StampedPose& sample : trajectory.poses()) {
    const auto from_last = [&] {
      return (sample.pose.translation() - poses.back().translation()).norm();
    };
    if (poses.empty() || from_last() > kNodeDistanceM) poses.push_back(sample.pose);
  }
  return poses;
}

std::vector<Pose> street_grid_poses(std::size_t count) {
  simulation::Random random(7);
  Eigen::Vector2i crossing(kBlocks / 2, kBlocks / 2);
  int heading = 0;  // quarter turns
  std::vector<Pose> poses;
  while (poses.size() < count) {
    if (!random.chance(0.6)) heading = (heading + (random.chance(0.5) ? 1 : 3)) % 4;
    const Eigen::Vector2i ahead(std::array{1, 0, -1, 0}[static_cast<std::size_t>(heading)],
                                std::array{0, 1, 0, -1}[static_cast<std::size_t>(heading)]);
    const Eigen::Vector2i next = crossing + ahead;
    if (next.minCoeff() < 0 || next.maxCoeff() > kBlocks) {
      heading = (heading + 1) % 4;
      continue;
    }
    for (int step = 0; step < kStepsABlock && poses.size() < count; ++step) {
      Pose T = Pose::Identity();
      const Eigen::Vector2d p =
          kNodeDistanceM * (kStepsABlock * crossing + step * ahead).cast<double>();
      T.translation() << p.x(), 0, p.y();
      T.rotate(Eigen::AngleAxisd(-heading * std::numbers::pi / 2, Eigen::Vector3d::UnitY()));
      poses.push_back(T);
    }
    crossing = next;
  }
  return poses;
}

PoseGraph loopy_graph(const std::vector<Pose>& truth, std::uint64_t seed) {
  simulation::Random random(seed);
  const PoseSigma neighbours{0.02 * kNodeDistanceM, 0.1 * std::numbers::pi / 180};
  const PoseSigma loops;
  PoseGraph graph;
  EarlierPoses earlier;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    if (i == 0) {
      graph.nodes[id_of(0)] = truth[0];
    } else {
      Constraint c = measurement(truth, i - 1, i, neighbours, random);
      c.kind = ConstraintKind::kBidirectional;
      graph.nodes[c.to] = graph.nodes.at(c.from) * c.T_from_to;
      graph.constraints.push_back(c);
    }
    for (const std::size_t j : earlier.near(i, truth)) {
      Constraint c = measurement(truth, j, i, loops, random);
      c.kind = ConstraintKind::kLoop;
      graph.constraints.push_back(c);
    }
    earlier.add(i, truth[i].translation());
  }
  return graph;
}

}  // namespace cellmap::bench
