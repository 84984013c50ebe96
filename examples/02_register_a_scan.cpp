// A later scan is registered to a CELL, from a guess that is half a metre off.
#include <cellmap/cell/build_cell.hpp>
#include <cellmap/registration/registration.hpp>
#include <cellmap/simulation/simulator.hpp>
#include <iostream>

int main() {
  cellmap::SimulatorOptions drive;
  drive.scans = 12;
  drive.odometry = "truth";
  drive.lidar.columns = 500;
  const auto source = cellmap::simulate(drive);
  const auto base = source->next().value();
  cellmap::LocalMap local_map(cellmap::filter_scan(base.points, base.stamp, {}), base.T_odom_sensor,
                              0);
  for (int i = 1; i < 6; ++i) {
    const auto scan = source->next().value();
    local_map.add(cellmap::filter_scan(scan.points, scan.stamp, {}), scan.T_odom_sensor);
  }
  const auto lattice = std::make_shared<const cellmap::Lattice>(
      cellmap::LatticeSpec{cellmap::LatticeKind::kFibonacci, 50'000});
  const cellmap::RegistrationTarget target(
      std::make_shared<const cellmap::Cell>(cellmap::build_cell(local_map, *lattice, {})), lattice);

  source->seek(10);
  const auto later = source->next().value();
  const cellmap::Pose truth = local_map.T_odom_cell().inverse() * later.T_odom_sensor;
  cellmap::Pose guess = truth;
  guess.translation() += Eigen::Vector3d(0.4, -0.3, 0.05);
  const auto found = cellmap::register_scan(
      target, cellmap::filter_scan(later.points, later.stamp, {}).points, guess);

  const double off_m = (found.T_target_source.translation() - truth.translation()).norm();
  std::cout << (found.converged ? "converged" : "not converged") << " after " << found.iterations
            << " iterations, " << 1000 * off_m << " mm from the truth; "
            << 100 * found.scores.inlier_ratio_hit << " % of the points on their surface\n";
  return found.converged && off_m < 0.05 ? 0 : 1;
}
