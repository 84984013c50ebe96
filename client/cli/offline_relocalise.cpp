#include "client/cli/offline_relocalise.hpp"

#include <chrono>
#include <map>
#include <memory>

#include "cellmap/place/relocalise.hpp"
#include "cellmap/scan/scan.hpp"

namespace cellmap::cli {

Relocalisation relocalise_offline(MapReader& reader, const std::string& map,
                                  const RelocalisationQuery& query, int threads) {
  const auto begun = std::chrono::steady_clock::now();
  const MapInfo info = reader.map(map);
  const auto lattice = std::make_shared<const Lattice>(info.lattice);
  PoseGraph graph = reader.pose_graph(map);
  for (const CellId id : graph.unaligned) graph.nodes.erase(id);  // no place in the map yet
  std::map<CellId, CellRecord> records;
  PlaceIndex index;
  const std::vector<CellRecord> cells = reader.all_cells(map);
  reader.for_each_cell(map, cells, [&](const CellRecord& record, const EncodedCell& cell) {
    if (!graph.nodes.contains(record.id)) return;  // or added since the pose graph was read
    index.add(record.id, decode_cell(cell.bytes), *lattice);
    records.emplace(record.id, record);
  });
  const TargetProvider targets = [&](CellId id) {
    return std::make_shared<const RegistrationTarget>(
        std::make_shared<const Cell>(decode_cell(reader.cell(map, records.at(id)).bytes)), lattice);
  };
  RelocaliseOptions options;
  options.threads = threads;
  Relocalisation result;
  result.answer = index.relocalise(query, graph, targets, options);
  if (const auto& found = result.answer.found) {
    result.cell_hash = records.at(found->cell).hash;
    if (info.georeference) result.geopose = to_geopose(*info.georeference, found->T_map_scan);
  }
  result.revision = graph.revision;
  result.time_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count();
  return result;
}

}  // namespace cellmap::cli
