#include "client/cli/diff.hpp"

#include <CLI/CLI.hpp>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/client/diff_json.hpp"
#include "cellmap/client/files.hpp"
#include "client/cli/arguments.hpp"
#include "client/cli/client_options.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/offline_diff.hpp"

namespace cellmap::cli {
namespace {

struct DiffArguments {
  Place place;
  std::string map, near, ply;
  std::vector<std::string> sessions;
  double radius_m = 0;
  bool patches = false;
  int threads = 0;
};

DiffRequest diff_request(const DiffArguments& options) {
  DiffRequest request;
  if (options.sessions.size() != 2) {
    throw Error(ErrorCode::kInvalidArgument,
                "--sessions names two, the earlier one first: --sessions monday,tuesday");
  }
  request.sessions = {options.sessions[0], options.sessions[1]};
  if (options.near.empty() != (options.radius_m == 0)) {
    throw Error(ErrorCode::kInvalidArgument, "--near \"x,y,z\" and --radius METRES go together");
  }
  if (!options.near.empty()) {
    const auto near = parse_numbers<3>("--near", "x,y,z", options.near);
    request.near = Eigen::Vector3d(near[0], near[1], near[2]);
    request.radius_m = options.radius_m;
  }
  request.patches = options.patches || !options.ply.empty();
  return request;
}

/// Where changed patches are, red where something vanished, green where something appeared.
std::string ply_text(MapReader& reader, const std::string& map, const MapDiff& diff) {
  std::map<CellId, const CellChangeCounts*> changed;
  for (const CellChangeCounts& cell : diff.cells) {
    if (!cell.changed.empty()) changed[cell.cell] = &cell;
  }
  std::vector<CellRecord> records = reader.all_cells(map);
  std::erase_if(records, [&](const CellRecord& record) { return !changed.contains(record.id); });
  const Lattice lattice(reader.map(map).lattice);
  std::size_t points = 0;
  std::string rows;
  reader.for_each_cell(map, records, [&](const CellRecord& record, const EncodedCell& encoded) {
    const Cell cell = decode_cell(encoded.bytes);
    const CellChangeCounts& counts = *changed.at(record.id);
    const bool vanished = counts.session == diff.sessions[0];
    for (const std::uint32_t index : counts.changed) {
      const auto at = std::ranges::lower_bound(cell.indices, index);
      if (at == cell.indices.end() || *at != index) continue;
      const Plane& plane = cell.planes[static_cast<std::size_t>(at - cell.indices.begin())];
      const Eigen::Vector3d p =
          record.T_map_cell * (static_cast<double>(plane.distance_m) * lattice.direction(index));
      rows +=
          format("%.3f %.3f %.3f %s\n", p.x(), p.y(), p.z(), vanished ? "220 40 40" : "40 180 60");
      ++points;
    }
  });
  return format("ply\nformat ascii 1.0\ncomment red vanished, green appeared\nelement vertex %zu\n",
                points) +
         "property float x\nproperty float y\nproperty float z\nproperty uchar red\n"
         "property uchar green\nproperty uchar blue\nend_header\n" +
         rows;
}

std::string diff_text(const MapDiff& diff) {
  std::string text;
  for (const ChangeRegion& region : diff.regions) {
    const Eigen::Vector3d size = region.box.sizes();
    text += format("%-8s at %9.2f %9.2f %7.2f  %4.1f x %4.1f x %4.1f m  %6.1f m2  %5u patches\n",
                   std::string(to_string(region.change)).c_str(), region.centroid.x(),
                   region.centroid.y(), region.centroid.z(), size.x(), size.y(), size.z(),
                   region.area_m2, region.patches);
  }
  if (diff.regions.empty()) text = "No change was found.\n";
  for (const std::string& session : diff.sessions) {
    std::uint64_t cells = 0, stayed = 0, changed = 0, never_seen = 0;
    for (const CellChangeCounts& cell : diff.cells) {
      if (cell.session != session) continue;
      ++cells;
      stayed += cell.stayed;
      changed += cell.vanished + cell.appeared;
      never_seen += cell.never_seen;
    }
    text += format(
        "%s: %s CELLs; %s patches stayed, %s %s, %s never seen by the other\n", session.c_str(),
        with_commas(cells).c_str(), with_commas(stayed).c_str(), with_commas(changed).c_str(),
        session == diff.sessions[0] ? "vanished" : "appeared", with_commas(never_seen).c_str());
  }
  return text;
}

void run_diff(const DiffArguments& options, const Console& console) {
  const DiffRequest request = diff_request(options);
  const bool offline = options.place.is_offline();
  const Interrupt interrupt;
  const auto reader = open_reader(options.place);
  MapDiff diff;
  if (offline) {
    diff = diff_offline(*reader, options.map, request, options.threads, interrupt.token());
  } else {
    diff = diff_sessions(client_options_of(options.place), options.map, request);
  }
  if (!options.ply.empty()) {
    client::write_file_atomically(options.ply, ply_text(*reader, options.map, diff));
  }
  console.print(client::to_json(diff, request.patches), diff_text(diff));
}

}  // namespace

void add_diff(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<DiffArguments>();
  CLI::App* verb =
      verbs.add(app, "diff", "What changed between two sessions of a map",
                "  cellmap diff town --sessions monday,tuesday --server http://127.0.0.1:8080\n"
                "  cellmap diff town --sessions monday,tuesday --store map.db --ply changes.ply\n"
                "Lists places where something vanished or appeared, the largest first. What is "
                "listed mostly\n"
                "did change; what no clear view saw, or only at a grazing angle, is not listed.\n",
                [options](const Console& console) { run_diff(*options, console); });
  verb->add_option("MAP", options->map, "Name of the map")->required();
  verb->add_option("--sessions", options->sessions, "Two names, the earlier one first: a,b")
      ->delimiter(',')
      ->required();
  add_place_options(*verb, options->place, true, true);
  verb->add_option("--near", options->near, "Only CELLs around this place, \"x,y,z\", map frame");
  verb->add_option("--radius", options->radius_m, "Metres around --near")
      ->check(CLI::PositiveNumber);
  verb->add_option("--ply", options->ply,
                   "Write the changed patches as points: red vanished, green appeared");
  verb->add_flag("--patches", options->patches,
                 "With --json: name each CELL's changed patches (lattice points)");
  verb->add_option("--threads", options->threads, "With --store and --mirror: threads; 0: all")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
}

}  // namespace cellmap::cli
