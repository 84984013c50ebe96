#include "client/cli/export_cells.hpp"

#include <CLI/CLI.hpp>
#include <cmath>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/core/progress.hpp"
#include "cellmap/export/disc_file.hpp"
#include "cellmap/export/occupancy_grid.hpp"
#include "cellmap/export/patch_points.hpp"
#include "cellmap/export/point_file.hpp"
#include "cellmap/export/tiles.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/map_reader.hpp"

namespace cellmap::cli {
namespace {

struct ExportCellsArguments {
  Place place;
  std::string map, out, format, session;
  double density = 0;  // points a square metre
  double tile_m = 20;
  OccupancyOptions occupancy;
};

using OnCell = std::function<void(const Cell&, const Lattice&, const Pose& T_map_cell)>;

/// Shows every CELL of the map at its current pose, one at a time, and returns how many there were.
/// Those of sessions that are not in the map frame yet are left out and counted in `unaligned`.
std::size_t for_each_cell(const ExportCellsArguments& options, const Console& console,
                          const OnCell& on_cell, std::size_t& unaligned) {
  const Interrupt interrupt;
  const auto reader = open_reader(options.place);
  const Lattice lattice(reader->map(options.map).lattice);
  const PoseGraph graph = reader->pose_graph(options.map);
  std::vector<CellRecord> cells = reader->all_cells(options.map);
  if (!options.session.empty()) {
    std::erase_if(cells, [&](const auto& cell) { return cell.session != options.session; });
  }
  unaligned = std::erase_if(
      cells, [&](const CellRecord& cell) { return graph.unaligned.contains(cell.id); });
  if (cells.empty()) {
    throw Error(ErrorCode::kNotFound, "map '" + options.map + "' has no CELLs to export" +
                                          (unaligned > 0 ? " that are in the map frame" : ""));
  }
  ProgressBar bar(console, "export");
  std::size_t done = 0;
  reader->for_each_cell(options.map, cells, [&](const CellRecord& record, const EncodedCell& cell) {
    throw_if_stopped(interrupt.token());
    on_cell(decode_cell(cell.bytes), lattice, record.T_map_cell);
    bar.update(++done, cells.size(), "CELLs");
  });
  return cells.size();
}

double spacing_of(const ExportCellsArguments& options) {
  return options.density > 0 ? 1 / std::sqrt(options.density) : 0;
}

void print(const ExportCellsArguments& options, const Console& console, std::size_t cells,
           std::size_t unaligned, client::Json counts, const std::string& what) {
  counts["file"] = options.out;
  counts["cells"] = cells;
  counts["cells_unaligned"] = unaligned;
  std::string text =
      format("Wrote %s of %zu CELLs to %s\n", what.c_str(), cells, options.out.c_str());
  if (unaligned > 0) {
    text += format("%zu CELLs of sessions that are not in the map frame yet were left out\n",
                   unaligned);
  }
  console.print(counts, text);
}

void export_points(const ExportCellsArguments& options, const Console& console) {
  const PointFormat format = options.format.empty() ? point_format_of(options.out)
                                                    : point_format_of("points." + options.format);
  PointFileWriter file(options.out, format);
  std::size_t unaligned = 0;
  const std::size_t cells = for_each_cell(
      options, console,
      [&](const Cell& cell, const Lattice& lattice, const Pose& T_map_cell) {
        const PointsOnPatches patches =
            patch_points(cell, lattice, T_map_cell, spacing_of(options));
        file.add(patches.points, patches.normals);
      },
      unaligned);
  file.finish();
  print(options, console, cells, unaligned, {{"points", file.points()}},
        with_commas(file.points()) + " points");
}

void export_discs(const ExportCellsArguments& options, const Console& console) {
  DiscFileWriter file(options.out);
  std::size_t unaligned = 0;
  const std::size_t cells = for_each_cell(
      options, console,
      [&](const Cell& cell, const Lattice& lattice, const Pose& T_map_cell) {
        file.add(cell, lattice, T_map_cell);
      },
      unaligned);
  file.finish();
  print(options, console, cells, unaligned, {{"discs", file.discs()}},
        with_commas(file.discs()) + " discs");
}

void export_tiles(const ExportCellsArguments& options, const Console& console) {
  TileWriter tiles(options.out, options.tile_m);
  std::size_t unaligned = 0;
  const std::size_t cells = for_each_cell(
      options, console,
      [&](const Cell& cell, const Lattice& lattice, const Pose& T_map_cell) {
        const PointsOnPatches patches =
            patch_points(cell, lattice, T_map_cell, spacing_of(options));
        tiles.add(patches.points, patches.normals);
      },
      unaligned);
  tiles.finish();
  print(options, console, cells, unaligned, {{"points", tiles.points()}, {"tiles", tiles.tiles()}},
        with_commas(tiles.points()) + " points in " + with_commas(tiles.tiles()) + " tiles");
}

void export_occupancy(const ExportCellsArguments& options, const Console& console) {
  OccupancyGrid grid(options.occupancy);
  std::size_t unaligned = 0;
  const std::size_t cells = for_each_cell(
      options, console,
      [&](const Cell& cell, const Lattice& lattice, const Pose& T_map_cell) {
        grid.add(cell, lattice, T_map_cell);
      },
      unaligned);
  grid.write(options.out);
  print(options, console, cells, unaligned, {{"width", grid.width()}, {"height", grid.height()}},
        format("%s x %s pixels", with_commas(grid.width()).c_str(),
               with_commas(grid.height()).c_str()));
}

void add_density(CLI::App& verb, ExportCellsArguments& options) {
  verb.add_option("--density", options.density,
                  "Points a square metre on every patch; 0: one point a plane")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
}

}  // namespace

void add_cell_exports(CLI::App& group, Verbs& verbs) {
  const auto leaf = [&](const char* name, const char* description, const char* example,
                        const char* out,
                        void (*action)(const ExportCellsArguments&, const Console&)) {
    const auto options = std::make_shared<ExportCellsArguments>();
    CLI::App* verb = verbs.add(group, name, description, example,
                               [options, action](const Console& c) { action(*options, c); });
    verb->add_option("--map", options->map, "Name of the map")->required();
    verb->add_option("--out", options->out, out)->required();
    verb->add_option("--session", options->session, "Only CELLs of this drive");
    add_place_options(*verb, options->place, true, true);
    return std::pair(verb, options);
  };
  const auto [points, point_options] =
      leaf("points", "Points with normals as PLY, PCD or LAS, map frame, metres",
           "  cellmap export points --store map.db --map town --density 25 --out town.las\n"
           "PLY and PCD: x, y, z and the normal as float. LAS 1.2: to a millimetre, no normals.\n",
           "File to write", export_points);
  points
      ->add_option("--format", point_options->format,
                   "ply, pcd or las (default: by the ending of --out)")
      ->check(CLI::IsMember({"ply", "pcd", "las"}));
  add_density(*points, *point_options);
  leaf("discs", "Every plane as a hexagon of a PLY mesh, map frame, metres",
       "  cellmap export discs --store map.db --map town --out town-discs.ply\n",
       "File to write (.ply)", export_discs);
  const auto [tiles, tile_options] =
      leaf("tiles", "Points in square tiles with metadata, as Autoware loads them",
           "  cellmap export tiles --store map.db --map town --density 25 --out "
           "pointcloud_map\n"
           "PCD files with normals, map frame, metres, named for their lower corner.\n",
           "Folder to write", export_tiles);
  tiles->add_option("--tile", tile_options->tile_m, "Edge of a tile, whole metres")
      ->capture_default_str();
  add_density(*tiles, *tile_options);
  const auto [occupancy, grid_options] =
      leaf("occupancy", "A level slice as nav2's map_server loads it: PGM and YAML",
           "  cellmap export occupancy --store map.db --map town --out town.yaml\n"
           "Occupied: patches between two heights above their CELL's ground. Free: where ground "
           "was seen.\nThe origin is the lower left corner in the map frame, metres.\n",
           "File to write (.yaml); the image goes beside it", export_occupancy);
  OccupancyOptions& grid = grid_options->occupancy;
  occupancy->add_option("--resolution", grid.resolution_m, "Edge of a pixel, metres")
      ->capture_default_str();
  occupancy->add_option("--lowest", grid.lowest_m, "Obstacles begin above the ground, metres")
      ->capture_default_str();
  occupancy->add_option("--highest", grid.highest_m, "and end, metres")->capture_default_str();
  occupancy->add_option("--range", grid.max_range_m, "Farther patches say nothing, metres")
      ->capture_default_str();
}

}  // namespace cellmap::cli
