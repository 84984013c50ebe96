// A drive becomes a map in memory: CELLs, constraints between them, and poses that agree with both.
#include <cellmap/pipeline/build_map.hpp>
#include <cellmap/simulation/simulator.hpp>
#include <iostream>
#include <map>

int main() {
  cellmap::SimulatorOptions drive;
  drive.scans = 120;
  drive.lidar.columns = 400;
  const auto source = cellmap::simulate(drive);

  const auto lattice = std::make_shared<const cellmap::Lattice>(
      cellmap::LatticeSpec{cellmap::LatticeKind::kFibonacci, 20'000});
  std::map<cellmap::CellId, std::shared_ptr<const cellmap::Cell>>
      cells;  // the mapper asks for them
  const cellmap::MapAccess access{[&](cellmap::CellId id) {
    return std::make_shared<const cellmap::RegistrationTarget>(cells.at(id), lattice);
  }};
  cellmap::Mapper mapper({}, "monday", lattice, {}, access);

  std::uint32_t constraints = 0;
  cellmap::build_map(*source, mapper, [&](cellmap::CellUpdate&& update) {
    if (update.cell) cells[update.id] = update.cell;
    std::vector<cellmap::ConstraintId> ids;  // a store would number them
    for (std::size_t i = 0; i < update.constraints.size(); ++i)
      ids.push_back(cellmap::ConstraintId{++constraints});
    mapper.number(ids);
  });

  for (const auto& [id, T_map_cell] : mapper.graph().nodes) {
    std::cout << "CELL " << id.value << " with " << cells.at(id)->planes.size() << " planes at "
              << T_map_cell.translation().transpose() << '\n';
  }
  std::cout << constraints << " constraints\n";
  return cells.size() > 5 && constraints + 1 >= cells.size() ? 0 : 1;
}
