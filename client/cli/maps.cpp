#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "cellmap/store/convert_cells.hpp"
#include "client/cli/archive_difference.hpp"
#include "client/cli/archive_reader.hpp"
#include "client/cli/arguments.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/form_flags.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/job_text.hpp"
#include "client/cli/map_reader.hpp"
#include "client/cli/map_text.hpp"

namespace cellmap::cli {
namespace {

struct MapsArguments {
  Place place;
  std::string map, near, box, session;
  double radius_m = 0;
  std::size_t limit = 1000;
  std::uint64_t since = 0;
  bool all = false, clear = false;
  std::vector<std::string> diff;
  FormFlags form;
  std::string origin;
  double heading_deg = 90;
  std::string lattice = to_string(LatticeKind::kFibonacci);
  std::uint32_t lattice_size = LatticeSpec{}.size;
};

void list_maps(const MapsArguments& options, const Console& console) {
  client::Json json = client::Json::array();
  std::string text;
  for (const MapInfo& map : open_reader(options.place)->maps()) {
    json.push_back(client::to_json(map));
    text += map_line(map);
  }
  console.print({{"maps", json}}, text.empty() ? "No maps.\n" : text);
}

void show_map(const MapsArguments& options, const Console& console);

void create_map(const MapsArguments& options, const Console& console) {
  const LatticeSpec lattice{lattice_kind_from(options.lattice), options.lattice_size};
  const CellForm form = options.form.form().value_or(CellForm{});
  const MapInfo map =
      options.place.store.empty()
          ? connect(options.place).create_map(options.map, lattice, form)
          : open_existing_store(options.place.store)->create_map(options.map, lattice, form);
  console.print(client::to_json(map), map_text(map));
}

void delete_map(const MapsArguments& options, const Console& console) {
  if (options.place.store.empty()) {
    connect(options.place).delete_map(options.map);
  } else {
    open_existing_store(options.place.store)->delete_map(options.map);
  }
  console.print({{"deleted", options.map}}, "Deleted map " + options.map + ".\n");
}

void convert_in_server(const MapsArguments& options, const CellForm& form, const Console& console) {
  const Interrupt interrupt;
  Client client = connect(options.place);
  const std::uint64_t cells = client.map(options.map).cells;
  Job job = client.convert(options.map, form);
  {
    ProgressBar bar(console, "convert");
    job = client.follow_job(
        job.id, [&](const Job& latest) { bar.update(latest.cells_done, cells, "CELLs"); },
        interrupt.token());
  }
  if (!is_final(job.state)) {
    throw Error(ErrorCode::kCancelled, "stopped watching; job " + std::to_string(job.id.value) +
                                           " goes on in the server (cellmap jobs follow)");
  }
  throw_unless_succeeded(job);
}

void convert_map(const MapsArguments& options, const Console& console) {
  const auto form = options.form.form();
  if (!form) {
    throw Error(ErrorCode::kInvalidArgument, "--encoding raw, packed or compact is needed");
  }
  if (options.place.store.empty()) {
    convert_in_server(options, *form, console);
  } else {
    const Interrupt interrupt;
    const auto store = open_existing_store(options.place.store);
    const std::uint64_t cells = store->map(options.map).cells;
    ProgressBar bar(console, "convert");
    convert_cells(*store, options.map, *form, interrupt.token(),
                  [&](const Progress& done) { bar.update(done.cells_done, cells, "CELLs"); });
  }
  show_map(options, console);
}

void show_map(const MapsArguments& options, const Console& console) {
  const MapInfo map = open_reader(options.place)->map(options.map);
  console.print(client::to_json(map), map_text(map));
}

/// What changed from one archive to another, by the hashes of their CELLs.
void show_difference(const std::vector<std::string>& files, const Console& console) {
  Place place;
  ArchiveReader a(open_bytes(files[0], place)), b(open_bytes(files[1], place));
  const ArchiveDifference found = difference(a, b);
  const auto count = [](const auto& list) { return with_commas(list.size()); };
  console.print(
      to_json(found),
      format("%s -> %s\n  CELLs        %s alike, %s added, %s removed, %s changed\n"
             "  poses        %s moved, by up to %.3f m and %.3f deg\n"
             "  constraints  %zu -> %zu\n  revision     %llu -> %llu\n",
             files[0].c_str(), files[1].c_str(), with_commas(found.alike).c_str(),
             count(found.added).c_str(), count(found.removed).c_str(), count(found.changed).c_str(),
             with_commas(found.moved).c_str(), found.farthest_m,
             found.largest_turn_rad * 180 / std::numbers::pi, found.constraints[0],
             found.constraints[1], static_cast<unsigned long long>(found.revisions[0]),
             static_cast<unsigned long long>(found.revisions[1])));
}

void show_info(const MapsArguments& options, const Console& console) {
  if (!options.diff.empty()) return show_difference(options.diff, console);
  MapsArguments of_map = options;
  if (of_map.map.empty() && !of_map.place.archive.empty()) {
    of_map.map = open_reader(of_map.place)->maps().front().name;
  }
  show_map(of_map, console);
}

Georeference georeference_of(const MapsArguments& options) {
  const auto place = parse_numbers<3>("--origin", "latitude,longitude,height", options.origin);
  Georeference georeference{place[0], place[1], place[2], Eigen::Matrix3d::Identity()};
  // A heading turns clockwise from north, angles about the vertical counter-clockwise from east.
  const double yaw_rad = (90 - options.heading_deg) * std::numbers::pi / 180;
  georeference.R_enu_map = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  georeference.validate();
  return georeference;
}

void set_georeference(const MapsArguments& options, const Console& console) {
  if (options.origin.empty() != options.clear) {
    throw Error(ErrorCode::kInvalidArgument, "give either --origin or --clear");
  }
  std::optional<Georeference> georeference;
  if (!options.clear) georeference = georeference_of(options);
  if (options.place.store.empty()) {
    connect(options.place).set_georeference(options.map, georeference);
  } else {
    open_existing_store(options.place.store)->set_georeference(options.map, georeference);
  }
  show_map(options, console);
}

CellQuery cell_query(const MapsArguments& options) {
  CellQuery query;
  query.limit = options.limit;
  query.since = options.since;
  if (!options.session.empty()) query.session = options.session;
  if (options.near.empty() != (options.radius_m == 0)) {
    throw Error(ErrorCode::kInvalidArgument, "--near \"x,y,z\" and --radius METRES go together");
  }
  if (!options.near.empty()) {
    const auto near = parse_numbers<3>("--near", "x,y,z", options.near);
    query.near = Eigen::Vector3d(near[0], near[1], near[2]);
    query.radius_m = options.radius_m;
  }
  if (!options.box.empty()) {
    const auto box = parse_numbers<6>("--bbox", "x0,y0,z0,x1,y1,z1", options.box);
    query.box = Eigen::AlignedBox3d(Eigen::Vector3d(box[0], box[1], box[2]),
                                    Eigen::Vector3d(box[3], box[4], box[5]));
  }
  return query;
}

void list_cells(const MapsArguments& options, const Console& console) {
  const auto reader = open_reader(options.place);
  CellQuery query = cell_query(options);
  CellPage page = reader->cells(options.map, query);
  while (options.all && !page.next_cursor.empty()) {
    query.cursor = page.next_cursor;
    CellPage more = reader->cells(options.map, query);
    page.cells.insert(page.cells.end(), more.cells.begin(), more.cells.end());
    page.next_cursor = more.next_cursor;
  }
  std::string text;
  for (const CellRecord& cell : page.cells) {
    const auto position = cell.T_map_cell.translation();
    text +=
        format("%6u  %s  %9.2f %9.2f %8.2f  %6s planes  %9s  %s %u\n", cell.id.value,
               to_hex(cell.hash).substr(0, 12).c_str(), position.x(), position.y(), position.z(),
               with_commas(cell.planes).c_str(), human_bytes(double(cell.encoded_bytes)).c_str(),
               cell.session.c_str(), cell.sequence);
  }
  if (text.empty()) text = "No CELLs.\n";
  if (!page.next_cursor.empty()) text += "There are more: raise --limit or give --all.\n";
  console.print(client::to_json(page), text);
}

void add_list(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<MapsArguments>();
  CLI::App* list =
      verbs.add(app, "maps", "List the maps; make, place or delete one",
                "  cellmap maps --server http://127.0.0.1:8080\n"
                "  cellmap maps create town --lattice-size 20000 --server URL\n"
                "  cellmap maps create town --encoding compact --bound 20mm --server URL\n"
                "  cellmap maps delete town --server URL\n",
                [options](const Console& console) { list_maps(*options, console); });
  add_place_options(*list, options->place, true, true);

  const auto created = std::make_shared<MapsArguments>();
  CLI::App* create = verbs.add(*list, "create", "Make an empty map",
                               "  cellmap maps create town --server http://127.0.0.1:8080\n",
                               [created](const Console& c) { create_map(*created, c); });
  create->add_option("MAP", created->map, "1 to 64 characters [a-z0-9_-]")->required();
  create
      ->add_option("--lattice", created->lattice, "fibonacci, or fibonacci-bands: without the sky")
      ->capture_default_str();
  create
      ->add_option("--lattice-size", created->lattice_size,
                   "Directions of its lattice, all around in its usual density")
      ->capture_default_str();
  add_form_flags(*create, created->form, "How its CELLs are kept; without it raw");
  add_place_options(*create, created->place, true);

  const auto converted = std::make_shared<MapsArguments>();
  CLI::App* convert = verbs.add(
      *list, "convert", "Keep a map's CELLs in other bytes, also those to come",
      "  cellmap maps convert town --encoding compact --bound 20mm --server URL\n"
      "  cellmap maps convert town --encoding packed --store map.db\n"
      "Broken off, the same command again goes on. Compact CELLs are other CELLs, each "
      "under its number:\nfollowers fetch them anew. There is no way back from compact.\n",
      [converted](const Console& c) { convert_map(*converted, c); });
  convert->add_option("MAP", converted->map, "Its name")->required();
  add_form_flags(*convert, converted->form, "How CELLs are kept");
  add_place_options(*convert, converted->place, true);

  const auto deleted = std::make_shared<MapsArguments>();
  CLI::App* remove = verbs.add(*list, "delete", "Delete a map with everything in it",
                               "  cellmap maps delete town --server http://127.0.0.1:8080\n",
                               [deleted](const Console& c) { delete_map(*deleted, c); });
  remove->add_option("MAP", deleted->map, "Its name")->required();
  add_place_options(*remove, deleted->place, true);

  const auto placed = std::make_shared<MapsArguments>();
  CLI::App* georeference =
      verbs.add(*list, "georeference", "Say where a map lies on Earth",
                "  cellmap maps georeference town --origin 49.0114,8.4204,116.4 --heading 32.5 "
                "--server URL\n"
                "'cellmap relocalise' then says the pose as an OGC GeoPose too.\n",
                [placed](const Console& c) { set_georeference(*placed, c); });
  georeference->add_option("MAP", placed->map, "Its name")->required();
  georeference->add_option("--origin", placed->origin,
                           "WGS-84 \"latitude,longitude,height\" of the map frame's origin, "
                           "degrees and metres above the ellipsoid");
  georeference
      ->add_option("--heading", placed->heading_deg,
                   "Where the map's x axis points: degrees clockwise from north")
      ->check(CLI::Range(-360.0, 360.0))
      ->capture_default_str();
  georeference->add_flag("--clear", placed->clear, "Take it back");
  add_place_options(*georeference, placed->place, true);
}

}  // namespace

void add_maps(CLI::App& app, Verbs& verbs) {
  add_list(app, verbs);

  const auto shown = std::make_shared<MapsArguments>();
  CLI::App* info = verbs.add(app, "info", "A map's summary: counts, bytes, bounds",
                             "  cellmap info town --server http://127.0.0.1:8080\n"
                             "  cellmap info town --store map.db --json\n"
                             "  cellmap info --archive town.cellmap\n"
                             "  cellmap info --diff monday.cellmap tuesday.cellmap\n",
                             [shown](const Console& console) { show_info(*shown, console); });
  info->add_option("MAP", shown->map, "Its name; may be left out for an archive");
  info->add_option("--diff", shown->diff, "Two archives: what changed from the one to the other")
      ->expected(2);
  info->parse_complete_callback([shown] {
    const bool is_named = !shown->map.empty() || !shown->place.archive.empty();
    if (!is_named && shown->diff.empty()) throw CLI::RequiredError("MAP");
  });
  add_place_options(*info, shown->place, true, true);

  const auto listed = std::make_shared<MapsArguments>();
  CLI::App* cells = verbs.add(app, "cells", "List CELLs by their current poses",
                              "  cellmap cells town --near \"10,-3,0\" --radius 20 --server URL\n"
                              "  cellmap cells town --bbox \"0,0,-5,50,50,5\" --store map.db\n",
                              [listed](const Console& console) { list_cells(*listed, console); });
  cells->add_option("MAP", listed->map, "Name of the map")->required();
  add_place_options(*cells, listed->place, true, true);
  cells->add_option("--near", listed->near, "\"x,y,z\" in the map frame; nearest come first");
  cells->add_option("--radius", listed->radius_m, "Metres around --near")
      ->check(CLI::PositiveNumber);
  cells->add_option("--bbox", listed->box, "\"x0,y0,z0,x1,y1,z1\" in the map frame");
  cells->add_option("--session", listed->session, "Only CELLs of this drive");
  cells->add_option("--since", listed->since, "Only CELLs added or moved after this revision");
  cells->add_option("--limit", listed->limit, "CELLs a page")
      ->check(CLI::Range(1, 10'000))
      ->capture_default_str();
  cells->add_flag("--all", listed->all, "All pages");
}

}  // namespace cellmap::cli
