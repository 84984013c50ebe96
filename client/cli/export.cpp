#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/client/files.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/export_cells.hpp"
#include "client/cli/map_reader.hpp"

#ifdef CELLMAP_WITH_PCL
#include "cellmap/pcl/scan_file.hpp"
#endif

namespace cellmap::cli {
namespace {

struct ExportArguments {
  Place place;
  std::string map, out, session, format = "tum", stage = "optimised";
};

#ifdef CELLMAP_WITH_PCL
/// One point and one normal a plane, map frame.
struct SurfelCloud {
  PointCloud points, normals;

  void add(const Cell& cell, const Lattice& lattice, const Pose& T_map_cell) {
    points.append(transformed(reconstruct_points(cell, lattice), T_map_cell));
    const Eigen::Matrix3d rotation = T_map_cell.linear();
    for (const Plane& plane : cell.planes) {
      const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
      normals.push_back((rotation * normal).cast<float>());
    }
  }
};

void export_cloud(const ExportArguments& options, const Console& console) {
  const std::string extension = std::filesystem::path(options.out).extension().string();
  if (extension != ".ply" && extension != ".pcd") {
    throw Error(ErrorCode::kInvalidArgument,
                "--out must end in .ply or .pcd, not '" + options.out + "'");
  }
  const auto reader = open_reader(options.place);
  const Lattice lattice(reader->map(options.map).lattice);
  const std::vector<CellRecord> cells = reader->all_cells(options.map);
  SurfelCloud cloud;
  std::size_t done = 0;
  {
    ProgressBar bar(console, "export");
    reader->for_each_cell(options.map, cells,
                          [&](const CellRecord& record, const EncodedCell& cell) {
                            cloud.add(decode_cell(cell.bytes), lattice, record.T_map_cell);
                            bar.update(++done, cells.size(), "CELLs");
                          });
  }
  pcl_io::write_cloud(options.out, cloud.points, &cloud.normals);
  console.print(
      {{"file", options.out}, {"cells", cells.size()}, {"points", cloud.points.size()}},
      format("Wrote %s points with normals of %zu CELLs to %s\n",
             with_commas(cloud.points.size()).c_str(), cells.size(), options.out.c_str()));
}
#else
void export_cloud(const ExportArguments&, const Console&) {
  throw Error(
      ErrorCode::kUnsupported,
      "this build has no PCL, which writes PLY and PCD; configure with CELLMAP_WITH_PCL=ON");
}
#endif

std::string session_of(const ExportArguments& options, const MapInfo& map) {
  if (!options.session.empty()) return options.session;
  if (map.sessions.size() == 1) return map.sessions.front();
  std::string names;
  for (const std::string& name : map.sessions) names += " " + name;
  throw Error(ErrorCode::kInvalidArgument,
              map.sessions.empty()
                  ? "map '" + map.name + "' has no scans yet"
                  : "map '" + map.name + "' has several sessions; give --session, one of:" + names);
}

void export_trajectory(const ExportArguments& options, const Console& console) {
  const auto reader = open_reader(options.place);
  const std::string session = session_of(options, reader->map(options.map));
  const std::string text = reader->trajectory_text(
      options.map, session,
      options.format == "kitti" ? TrajectoryFormat::kKitti : TrajectoryFormat::kTum,
      options.stage == "odometry" ? TrajectoryStage::kOdometry : TrajectoryStage::kCorrected);
  client::write_file_atomically(options.out, text);
  const auto rows = std::count_if(text.begin(), text.end(), [](char c) { return c == '\n'; });
  console.print({{"file", options.out}, {"session", session}, {"rows", rows}},
                format("Wrote %td poses of session %s (%s, %s) to %s\n", rows, session.c_str(),
                       options.stage.c_str(), options.format.c_str(), options.out.c_str()));
}

void export_graph(const ExportArguments& options, const Console& console) {
  const PoseGraph graph = open_reader(options.place)->pose_graph(options.map);
  client::write_file_atomically(options.out, to_g2o(graph));
  console.print({{"file", options.out},
                 {"revision", graph.revision},
                 {"nodes", graph.nodes.size()},
                 {"constraints", graph.constraints.size()}},
                format("Wrote %zu poses and %zu constraints to %s\n", graph.nodes.size(),
                       graph.constraints.size(), options.out.c_str()));
}

}  // namespace

void add_export(CLI::App& app, Verbs& verbs) {
  CLI::App* group = app.add_subcommand("export", "Write a map as files that other programs read");
  group->require_subcommand(1);
  const auto leaf = [&](const char* name, const char* description, const char* example,
                        void (*action)(const ExportArguments&, const Console&)) {
    const auto options = std::make_shared<ExportArguments>();
    CLI::App* verb = verbs.add(*group, name, description, example,
                               [options, action](const Console& c) { action(*options, c); });
    verb->add_option("--map", options->map, "Name of the map")->required();
    verb->add_option("--out", options->out, "File to write")->required();
    add_place_options(*verb, options->place, true, true);
    return std::pair(verb, options);
  };
  leaf("cloud", "One point and normal a plane as PLY or PCD",
       "  cellmap export cloud --server http://127.0.0.1:8080 --map town --out town.ply\n",
       export_cloud);
  const auto [trajectory, options] = leaf(
      "trajectory", "The pose of every scan as TUM or KITTI rows",
      "  cellmap export trajectory --store map.db --map town --format kitti --out town.txt\n"
      "  cellmap export trajectory --server URL --map town --stage odometry --out before.txt\n",
      export_trajectory);
  trajectory->add_option("--session", options->session, "Which drive, where the map has several");
  trajectory->add_option("--format", options->format, "tum or kitti")
      ->check(CLI::IsMember({"tum", "kitti"}))
      ->capture_default_str();
  trajectory
      ->add_option("--stage", options->stage,
                   "optimised: after the back end; odometry: as the poses came in")
      ->check(CLI::IsMember({"optimised", "odometry"}))
      ->capture_default_str();
  leaf("graph", "Poses and constraints as g2o",
       "  cellmap export graph --store map.db --map town --out town.g2o\n", export_graph);
  add_cell_exports(*group, verbs);
}

}  // namespace cellmap::cli
