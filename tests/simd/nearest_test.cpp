#include "cellmap/simd/nearest.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <random>
#include <vector>

#include "cellmap/geometry/lattice.hpp"
#include "support/instruction_sets.hpp"
#include "support/real_data.hpp"

namespace cellmap {
namespace {

/// CELLMAP_NEAREST_CHECKS=1000000000 makes this the check of a billion directions (minutes).
std::size_t checks() {
  const char* const given = std::getenv("CELLMAP_NEAREST_CHECKS");
  return given != nullptr ? std::strtoull(given, nullptr, 10) : 400'000;
}

/// One scan of KITTI 00; empty where it is not there.
PointCloud kitti_scan() {
  std::ifstream in(test::real_data("kitti00-consecutive") / "velodyne" / "000000.bin",
                   std::ios::binary);
  PointCloud cloud;
  for (std::array<float, 4> p; in.read(reinterpret_cast<char*>(p.data()), sizeof p);) {
    cloud.push_back({p[0], p[1], p[2]});
  }
  return cloud;
}

/// Checks batches of directions on every instruction set against the path in double.
class Checker {
 public:
  void check(const PointCloud& cloud) {
    expected_.resize(cloud.size());
    found_.resize(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      expected_[i] = lattice_.nearest(cloud[i].cast<double>());
    }
    test::for_each_instruction_set([&](const std::string& name) {
      lattice_.nearest(cloud, found_);
      std::size_t mismatches = 0;
      for (std::size_t i = 0; i < cloud.size(); ++i) mismatches += found_[i] != expected_[i];
      EXPECT_EQ(mismatches, 0U) << name;
    });
    checked_ += cloud.size();
  }
  std::size_t checked() const { return checked_; }

 private:
  Lattice lattice_{LatticeSpec{}};
  std::vector<std::uint32_t> expected_, found_;
  std::size_t checked_ = 0;
};

TEST(NearestOfManyDirections, IsTheDoubleArgmaxOnEveryInstructionSet) {
  constexpr std::size_t kBatch = 1 << 17;
  std::mt19937_64 random(3);
  std::normal_distribution<float> normal;
  const PointCloud scan = kitti_scan();
  Checker uniform, rays;
  while (uniform.checked() < checks() / 2) {
    PointCloud cloud;
    while (cloud.size() < kBatch) {
      cloud.push_back({normal(random), normal(random), normal(random)});
    }
    uniform.check(cloud);
  }
  while (!scan.empty() && rays.checked() < checks() / 2) {
    Tangent motion;  // a car that leans a little, anywhere, heading anywhere
    motion << normal(random), normal(random), 0.1 * normal(random), 0.02 * normal(random),
        0.02 * normal(random), 3 * normal(random);
    rays.check(transformed(scan, exp(motion)));
  }
  RecordProperty("uniform_directions", std::to_string(uniform.checked()));
  RecordProperty("kitti_rays", std::to_string(rays.checked()));
}

}  // namespace
}  // namespace cellmap
