#include "client/cli/offline_relocalise.hpp"

#include <chrono>
#include <map>
#include <memory>

#include "cellmap/place/relocalise.hpp"
#include "cellmap/scan/scan.hpp"

namespace cellmap::cli {
namespace {

Cell load(const Store& store, const std::string& map, CellId id) {
  return decode_stored_cell(*store.compressed_cell(map, id));
}

}  // namespace

Relocalisation relocalise_in_store(const Store& store, const std::string& map,
                                   const PointCloud& scan, const std::optional<PosePrior>& prior,
                                   int threads) {
  const auto begun = std::chrono::steady_clock::now();
  const auto lattice = std::make_shared<const Lattice>(store.map(map).lattice);
  const PoseGraph graph = store.pose_graph(map);
  PlaceIndex index;
  for (const auto& [id, pose] : graph.nodes) index.add(id, load(store, map, id), *lattice);
  const TargetProvider targets = [&](CellId id) {
    return std::make_shared<const RegistrationTarget>(
        std::make_shared<const Cell>(load(store, map, id)), lattice);
  };
  RelocaliseOptions options;
  options.threads = threads;
  const Scan clean = filter_scan(scan, 0, {});
  Relocalisation result;
  result.answer = index.relocalise(clean.points, graph, targets, prior, options);
  if (result.answer.found) result.cell_hash = store.cell(map, result.answer.found->cell).hash;
  result.revision = graph.revision;
  result.time_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count();
  return result;
}

}  // namespace cellmap::cli
