#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/registration/registration.hpp"
#include "cellmap/simulation/simulator.hpp"

namespace cellmap {
namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;

/// Neighbouring CELLs of a simulated drive through town, with cars that move and other noise in
/// every scan, 6 m apart. Their true poses are known.
class NeighboursInTown : public testing::Test {
 public:
  struct Outcome {
    bool converged;
    double error_m, error_deg;
  };

 protected:
  static void SetUpTestSuite() {
    places_ = std::make_unique<std::vector<Place>>();
    SimulatorOptions options;
    options.odometry = "truth";
    options.scans = 90;
    options.threads = 2;
    const auto source = simulate(options);
    const auto lattice = std::make_shared<const Lattice>(LatticeSpec{});
    std::optional<LocalMap> local_map;
    const auto finish = [&] {
      auto cell = std::make_shared<const Cell>(build_cell(*local_map, *lattice, {}));
      places_->push_back(
          {{std::move(cell), lattice}, local_map->base_scan().points, local_map->T_odom_cell()});
    };
    while (const auto raw = source->next()) {
      Scan scan = filter_scan(raw->points, raw->stamp, {});
      if (local_map && !local_map->is_complete_for(raw->T_odom_sensor, 6.0)) {
        local_map->add(scan, raw->T_odom_sensor);
        continue;
      }
      if (local_map) finish();
      local_map.emplace(std::move(scan), raw->T_odom_sensor,
                        static_cast<std::uint32_t>(raw->index));
    }
  }
  static void TearDownTestSuite() { places_.reset(); }

  /// Every pair of neighbours registered from a start that is off by this much in a direction and
  /// about an axis drawn at random, mostly level.
  static std::vector<Outcome> register_from(double off_m, double off_deg) {
    std::mt19937 rng(1);
    std::normal_distribution<double> normal;
    std::vector<Outcome> outcomes;
    for (std::size_t i = 0; i + 1 < places_->size(); ++i) {
      const Place &a = (*places_)[i], &b = (*places_)[i + 1];
      const Eigen::Vector3d shift(normal(rng), normal(rng), 0.2 * normal(rng));
      const Eigen::Vector3d turn(0.3 * normal(rng), 0.3 * normal(rng), normal(rng));
      Tangent off;
      off << off_m * shift.normalized(), off_deg / kDegPerRad * turn.normalized();
      const Pose T_true = a.T_world_cell.inverse() * b.T_world_cell;
      const RegistrationResult result =
          register_cells(a.target, a.base_scan, b.target, b.base_scan, T_true * exp(off));
      const Pose error = T_true.inverse() * result.T_target_source;
      outcomes.push_back({result.converged, error.translation().norm(),
                          kDegPerRad * angle_between_rad(Pose::Identity(), error)});
    }
    return outcomes;
  }

 private:
  struct Place {
    RegistrationTarget target;
    PointCloud base_scan;
    Pose T_world_cell;
  };
  static std::unique_ptr<std::vector<Place>> places_;
};
std::unique_ptr<std::vector<NeighboursInTown::Place>> NeighboursInTown::places_;

double median(const std::vector<NeighboursInTown::Outcome>& outcomes,
              double NeighboursInTown::Outcome::*value) {
  std::vector<double> values;
  for (const auto& outcome : outcomes) values.push_back(outcome.*value);
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

TEST_F(NeighboursInTown, ConvergeToMillimetresFromOneMetreAndFromTwo) {
  for (const auto& [off_m, off_deg] : {std::pair{0.3, 1.0}, {1.0, 3.0}, {2.0, 5.0}}) {
    const std::vector<Outcome> outcomes = register_from(off_m, off_deg);
    ASSERT_GE(outcomes.size(), 8U);
    for (const Outcome& outcome : outcomes) {
      EXPECT_TRUE(outcome.converged) << off_m;
      EXPECT_LT(outcome.error_m, 0.01) << off_m;
      EXPECT_LT(outcome.error_deg, 0.02) << off_m;
    }
    EXPECT_LT(median(outcomes, &Outcome::error_m), 0.002) << off_m;
    EXPECT_LT(median(outcomes, &Outcome::error_deg), 0.004) << off_m;
  }
}

/// Beyond its reach a registration may fail; then it must not say that it converged.
TEST_F(NeighboursInTown, FromTooFarNothingWrongIsCalledConverged) {
  for (const Outcome& outcome : register_from(3.0, 10.0)) {
    EXPECT_TRUE(!outcome.converged || outcome.error_m < 0.05) << outcome.error_m;
  }
}

}  // namespace
}  // namespace cellmap
