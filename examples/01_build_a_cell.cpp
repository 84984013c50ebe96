// Scans become a CELL: what it holds, and how many bytes it is.
#include <cellmap/cell/build_cell.hpp>
#include <cellmap/codec/cell_codec.hpp>
#include <cellmap/codec/coded_cell.hpp>
#include <cellmap/simulation/simulator.hpp>
#include <iostream>

int main() {
  cellmap::SimulatorOptions
      drive;  // a LiDAR in a simulated town; open_dataset() reads a real drive
  drive.scans = 20;
  drive.lidar.columns = 500;
  const auto source = cellmap::simulate(drive);

  // A local map stacks scans until the vehicle has gone 6 m from its first one.
  const auto first = source->next().value();
  cellmap::LocalMap local_map(cellmap::filter_scan(first.points, first.stamp, {}),
                              first.T_odom_sensor, 0);
  while (const auto scan = source->next()) {
    if (local_map.is_complete_for(scan->T_odom_sensor, 6.0)) break;
    local_map.add(cellmap::filter_scan(scan->points, scan->stamp, {}), scan->T_odom_sensor);
  }

  const cellmap::Lattice lattice({cellmap::LatticeKind::kFibonacci, 50'000});
  cellmap::Cell cell = cellmap::build_cell(local_map, lattice, {});
  cell.session = "monday";  // whose drive it is from
  const auto raw = cellmap::encode_cell(cell);
  std::cout << local_map.points().size() << " points became " << cell.planes.size()
            << " planes: " << raw.bytes.size() << " bytes, "
            << cellmap::encode_compact_cell(cell, 0.02).bytes.size() << " within 2 cm\n";
  return cell.planes.empty() ? 1 : 0;
}
