#include "client/cli/build_in_store.hpp"

#include <set>

#include "cellmap/core/error.hpp"

namespace cellmap::cli {
namespace {

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
  const auto places = std::make_shared<PlaceIndex>();
  std::set<CellId> indexed;
  const MapAccess access{[&](CellId id) {
                           return std::make_shared<const RegistrationTarget>(load(store, map, id),
                                                                             directions);
                         },
                         [&](const PoseGraph& graph) {
                           for (const auto& [id, pose] : graph.nodes) {
                             if (indexed.insert(id).second)
                               places->add(id, *load(store, map, id), *directions);
                           }
                           return places;
                         }};
  Mapper mapper(options, session, directions, store.pose_graph(map), access);
  Progress state{0, source.size(), 0};
  const auto commit = [&](std::optional<CellUpdate> update) {
    if (!update) return;
    mapper.number(store.commit(map, to_map_update(*std::move(update))).constraint_ids);
    ++state.cells_done;
  };

  if (!go_on(store, map, session, source, mapper, state)) return info;
  while (const auto scan = source.next()) {
    throw_if_stopped(stop);
    commit(mapper.add(*scan));
    state.scans_done = scan->index + 1;
    if (progress) progress(state);
  }
  commit(mapper.finish());
  return store.map(map);
}

}  // namespace cellmap::cli
