#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/cell/local_map.hpp"
#include "cellmap/cell/patch_outline.hpp"
#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/evaluation/representation.hpp"

namespace cellmap {
namespace {

constexpr char kPosesName[] = "poses.graph";

std::string name_of(const CellForm& form) {
  if (form.encoding == KeptEncoding::kRaw) return "CELLs, raw (the paper's)";
  if (form.encoding == KeptEncoding::kPacked) return "CELLs, packed";
  return "CELLs, compact, " + std::to_string(std::lround(form.bound_m() * 1000)) + " mm";
}

Bytes encoded(const CellForm& form, const Cell& cell) {
  if (form.encoding == KeptEncoding::kRaw) return encode_cell(cell).bytes;
  if (form.encoding == KeptEncoding::kPacked) return encode_packed_cell(cell).bytes;
  return encode_compact_cell(cell, form.bound_m()).bytes;
}

std::vector<Cell> build_cells(const ComparedDrive& drive, double cell_distance_m,
                              const CellBuildOptions& build, const Lattice& lattice) {
  std::vector<Cell> cells;
  std::optional<LocalMap> local_map;
  const auto finish = [&] {
    Cell cell = build_cell(*local_map, lattice, build);
    cell.session = "drive";
    cell.sequence = static_cast<std::uint32_t>(cells.size());
    cells.push_back(std::move(cell));
  };
  std::uint32_t index = 0;
  for (const PlacedScan& placed : drive.mapped) {
    if (local_map && local_map->is_complete_for(placed.T_map_scan, cell_distance_m)) {
      finish();
      local_map.reset();
    }
    if (local_map) {
      local_map->add(placed.scan, placed.T_map_scan);
    } else {
      local_map.emplace(placed.scan, placed.T_map_scan, index);
    }
    ++index;
  }
  if (local_map) finish();
  return cells;
}

MapFiles write_cells(const std::vector<Cell>& cells, const CellForm& form) {
  MapFiles files;
  PoseGraph graph;
  for (const Cell& cell : cells) {
    files.push_back({"cell_" + std::to_string(cell.sequence) + ".cell", encoded(form, cell)});
    graph.nodes[CellId{cell.sequence + 1}] = cell.T_odom_cell;
  }
  graph.next_cell = CellId{static_cast<std::uint32_t>(cells.size()) + 1};
  files.push_back({kPosesName, encode_pose_graph(graph)});
  return files;
}

DecodedMap read_cells(const MapFiles& files, const CellForm& form,
                      const std::shared_ptr<const Lattice>& lattice) {
  DecodedMap map;
  const auto poses = std::find_if(files.begin(), files.end(),
                                  [](const MapFile& file) { return file.name == kPosesName; });
  const PoseGraph graph = decode_pose_graph(poses->bytes);
  CellDecoder decoder;
  for (const MapFile& file : files) {
    if (&file == &*poses) continue;
    Cell cell = form.encoding == KeptEncoding::kRaw ? decode_cell(file.bytes)
                                                    : decoder.decode(file.bytes).cell;
    const Pose T_map_cell = graph.nodes.at(CellId{cell.sequence + 1});
    map.cells.push_back({std::make_shared<const RegistrationTarget>(
                             std::make_shared<const Cell>(std::move(cell)), lattice),
                         T_map_cell});
    const TriangleMesh patches = patch_mesh(map.cells.back().target->cell(), *lattice, T_map_cell);
    map.surface.append(patches);
  }
  return map;
}

}  // namespace

Representation cells(const CellForm& form, double cell_distance_m, const CellBuildOptions& build,
                     const LatticeSpec& spec) {
  build.validate();
  const auto lattice = std::make_shared<const Lattice>(spec);
  return {name_of(form),
          [=](const ComparedDrive& drive) {
            return write_cells(build_cells(drive, cell_distance_m, build, *lattice), form);
          },
          [=](const MapFiles& files) { return read_cells(files, form, lattice); }};
}

}  // namespace cellmap
