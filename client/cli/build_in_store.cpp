#include "client/cli/build_in_store.hpp"

#include "cellmap/core/error.hpp"
#include "cellmap/geometry/voxel_grid.hpp"

namespace cellmap::cli {
namespace {

constexpr double kVoxelSize_m = 0.4;
constexpr std::size_t kMaxVoxels = 15'000'000;

MapInfo open_or_make(Store& store, const std::string& name,
                     const std::optional<LatticeSpec>& lattice) {
  for (const MapInfo& map : store.maps()) {
    if (map.name != name) continue;
    if (lattice && map.lattice != *lattice) {
      throw Error(ErrorCode::kConflict,
                  "map '" + name + "' has the lattice " + to_string(map.lattice) + ", not " +
                      to_string(*lattice) + "; leave --lattice-size out or build another map");
    }
    return map;
  }
  return store.create_map(name, lattice.value_or(LatticeSpec{}));
}

std::shared_ptr<const Cell> load(const Store& store, const std::string& map, CellId id) {
  return std::make_shared<const Cell>(decode_stored_cell(*store.compressed_cell(map, id)));
}

MapUpdate to_map_update(const CellUpdate& update, std::uint64_t voxel_points) {
  MapUpdate result;
  result.cells.push_back({update.id, update.cell, encode_cell(*update.cell),
                          update.poses.at(update.id), update.scans, update.raw_points});
  result.poses = update.poses;
  result.poses.erase(update.id);
  result.add_constraints = update.constraints;
  result.voxel_points = voxel_points;
  return result;
}

/// Puts mapper and source behind the last stored CELL of the session. False where the drive ends
/// there.
bool go_on(const Store& store, const std::string& map, const std::string& session,
           ScanSource& source, Mapper& mapper, Progress& state) {
  const auto last = store.last_cell(map, session);
  if (!last) return true;
  const auto cell = load(store, map, last->id);
  const std::size_t next = cell->first_scan + std::size_t{cell->scan_count};
  state.scans_done = next;
  state.cells_done = last->sequence + std::size_t{1};
  if (next >= source.size()) return false;
  source.seek(cell->first_scan);
  mapper.resume_after(last->id, cell, source.next().value());
  source.seek(next);
  return true;
}

}  // namespace

MapInfo build_in_store(Store& store, const std::string& map,
                       const std::optional<LatticeSpec>& lattice, const std::string& session,
                       ScanSource& source, const MapperOptions& options,
                       const std::stop_token& stop, const ProgressCallback& progress) {
  const MapInfo info = open_or_make(store, map, lattice);
  const auto directions = std::make_shared<const Lattice>(info.lattice);
  const TargetProvider targets = [&](CellId id) {
    return std::make_shared<const RegistrationTarget>(load(store, map, id), directions);
  };
  Mapper mapper(options, session, directions, store.pose_graph(map), targets);
  Progress state{0, source.size(), 0};
  VoxelCounter voxels(kVoxelSize_m);
  const auto commit = [&](const std::optional<CellUpdate>& update) {
    if (!update) return;
    store.commit(map, to_map_update(*update, info.voxel_points + voxels.size()));
    ++state.cells_done;
  };

  if (!go_on(store, map, session, source, mapper, state)) return info;
  while (const auto scan = source.next()) {
    throw_if_stopped(stop);
    if (voxels.size() < kMaxVoxels) {
      const Scan clean = filter_scan(scan->points, scan->stamp, options.filter);
      voxels.add(transformed(clean.points, scan->T_odom_sensor));
    }
    commit(mapper.add(*scan));
    state.scans_done = scan->index + 1;
    if (progress) progress(state);
  }
  commit(mapper.finish());
  return store.map(map);
}

}  // namespace cellmap::cli
