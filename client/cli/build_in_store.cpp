#include "client/cli/build_in_store.hpp"

#include <set>
#include <utility>

#include "cellmap/core/error.hpp"
#include "cellmap/pipeline/build_map.hpp"
#include "cellmap/store/read_cell.hpp"

namespace cellmap::cli {
namespace {

MapInfo open_or_make(Store& store, const std::string& name,
                     const std::optional<LatticeSpec>& lattice, const CellForm& form) {
  for (const MapInfo& map : store.maps()) {
    if (map.name != name) continue;
    if (lattice && map.lattice != *lattice) {
      throw Error(ErrorCode::kConflict,
                  "map '" + name + "' has the lattice " + to_string(map.lattice) + ", not " +
                      to_string(*lattice) + "; leave --lattice-size out or build another map");
    }
    return map;
  }
  return store.create_map(name, lattice.value_or(LatticeSpec{}), form);
}

std::shared_ptr<const Cell> load(const Store& store, const std::string& map, CellId id) {
  return std::make_shared<const Cell>(read_cell(store, map, id));
}

/// Puts mapper and source behind the last stored CELL of the session, and says how many CELLs it
/// has. nullopt where the drive ends there.
std::optional<std::size_t> go_on(const Store& store, const std::string& map,
                                 const std::string& session, ScanSource& source, Mapper& mapper) {
  const auto last = store.last_cell(map, session);
  if (!last) return 0;
  const auto cell = load(store, map, last->id);
  const std::size_t next = cell->first_scan + std::size_t{cell->scan_count};
  if (next >= source.size()) return std::nullopt;
  source.seek(cell->first_scan);
  mapper.resume_after(last->id, cell, source.next().value());
  source.seek(next);
  return last->sequence + std::size_t{1};
}

}  // namespace

MapInfo build_in_store(Store& store, const std::string& map,
                       const std::optional<LatticeSpec>& lattice,
                       const std::optional<CellForm>& form, const std::string& session,
                       ScanSource& source, const MapperOptions& options,
                       const std::stop_token& stop, const ProgressCallback& progress) {
  const MapInfo info = open_or_make(store, map, lattice, form.value_or(CellForm{}));
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
  const auto done = go_on(store, map, session, source, mapper);
  if (!done) return info;
  std::optional<KeptCell> kept;
  mapper.on_finished([&](std::shared_ptr<const Cell> cell) {
    kept = keep_cell(std::move(cell), form.value_or(info.form));
    return kept->cell;
  });
  const auto commit = [&](CellUpdate&& update) {
    mapper.number(store.commit(map, to_map_update(std::move(update), std::exchange(kept, {})))
                      .constraint_ids);
  };
  build_map(source, mapper, commit, stop, [&](Progress state) {
    state.cells_done += *done;
    if (progress) progress(state);
  });
  return store.map(map);
}

}  // namespace cellmap::cli
