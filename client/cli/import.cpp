#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/codec/released_folder.hpp"
#include "cellmap/core/progress.hpp"
#include "cellmap/pose_graph/information.hpp"
#include "cellmap/store/open_store.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/map_text.hpp"
#include "client/cli/store_blobs.hpp"

namespace cellmap::cli {
namespace {

struct ImportArguments {
  std::string folder, store, map;
  ReleasedFolderOptions reading;
};

/// What odometry says of two neighbours: a centimetre and a tenth of a degree, or a hundredth of
/// the way.
Constraint constraint_between(CellId from, const Cell& a, CellId to, const Cell& b) {
  Constraint constraint;
  constraint.from = from;
  constraint.to = to;
  constraint.T_from_to = a.T_odom_cell.inverse() * b.T_odom_cell;
  const double way_m = constraint.T_from_to.translation().norm();
  const PoseSigma sigma = {std::max(0.01, 0.01 * way_m), 0.0017};
  constraint.information = information_of(sigma, constraint.T_from_to);
  return constraint;
}

/// CELL by CELL into a new map, which is gone again where that fails.
std::size_t import_into(Store& store, const ImportArguments& options, const ReleasedFolder& folder,
                        const Console& console) {
  const Interrupt interrupt;
  ProgressBar bar(console, "import");
  store.create_map(options.map, options.reading.lattice);
  std::size_t dropped = 0;
  std::shared_ptr<const Cell> previous;
  try {
    for (std::size_t k = 0; k < folder.size(); ++k) {
      throw_if_stopped(interrupt.token());
      ReleasedCell released = folder.read(k);
      dropped += released.dropped;
      NewCell added;
      added.id = CellId{static_cast<std::uint32_t>(k + 1)};
      added.cell = std::make_shared<const Cell>(std::move(released.cell));
      added.encoded = encode_cell(*added.cell);
      added.T_map_cell = added.cell->T_odom_cell;
      added.scans = std::move(released.scans);
      MapUpdate update;
      if (previous) {
        update.add_constraints.push_back(constraint_between(CellId{static_cast<std::uint32_t>(k)},
                                                            *previous, added.id, *added.cell));
      }
      previous = added.cell;
      update.cells.push_back(std::move(added));
      store.commit(options.map, update);
      bar.update(k + 1, folder.size(), "CELLs");
    }
  } catch (...) {
    store.delete_map(options.map);
    throw;
  }
  return dropped;
}

void run_import(const ImportArguments& options, const Console& console) {
  validate_map_name(options.map);
  const ReleasedFolder folder(options.folder, options.reading);
  const auto store = open_store(options.store, objects_of_environment());
  const std::size_t dropped = import_into(*store, options, folder, console);
  const MapInfo map = store->map(options.map);
  client::Json json = client::to_json(map);
  json["dropped_planes"] = dropped;
  console.print(json, map_text(map) + format("  dropped        %s planes that no CELL may have\n",
                                             with_commas(dropped).c_str()));
}

}  // namespace

void add_import(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<ImportArguments>();
  CLI::App* verb = verbs.add(
      app, "import", "Make a map of the folder that the paper's released code wrote",
      "  cellmap import cellmap_out --store map.db --map town\n"
      "The folder has cell_0.pcd, index_0.txt, ... and cell_odom.txt, the poses of the scans.\n"
      "Neighbours are tied by these poses; 'cellmap archive' and 'cellmap serve' go on from "
      "here.\n",
      [options](const Console& console) { run_import(*options, console); });
  verb->add_option("FOLDER", options->folder, "What the released code wrote")->required();
  verb->add_option("--poses", options->reading.poses,
                   "Poses of the scans, KITTI or TUM (default: cell_odom.txt of the folder)");
  verb->add_option("--cell-distance", options->reading.cell_distance_m,
                   "Its base_gap: a CELL begins beyond this distance, metres")
      ->capture_default_str();
  verb->add_option("--lattice-size", options->reading.lattice.size,
                   "Its param_ball_num: density of its lattice of three bands")
      ->check(CLI::Range(1'000, 500'000))
      ->capture_default_str();
  verb->add_option("--session", options->reading.session, "Name of the drive in the map")
      ->capture_default_str();
  verb->add_option("--store", options->store,
                   "Store: a file, made where it is missing, or postgresql://...")
      ->required();
  verb->add_option("--map", options->map, "Name of the map, which must be new")->required();
}

}  // namespace cellmap::cli
