#include "cellmap/client/archive.hpp"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/archive/store_archive.hpp"
#include "cellmap/archive/update_archive.hpp"
#include "cellmap/store/open_store.hpp"
#include "client/cli/archive_reader.hpp"
#include "client/cli/client_options.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/form_flags.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/map_reader.hpp"
#include "client/cli/map_text.hpp"
#include "client/cli/store_blobs.hpp"

// archive and restore.

namespace cellmap::cli {
namespace {

struct ArchiveArguments {
  Place place;
  std::string map, file;
  FormFlags form;
  bool update = false;
};

std::string summary(const std::string& file, const MapInfo& map, std::uint64_t bytes,
                    const ArchiveFooter& footer) {
  std::string encoding(to_string(footer.encoding));
  if (footer.bound_m > 0) encoding += format(", within %g mm", footer.bound_m * 1e3);
  return format(
      "%s: %s\n  map       %s, revision %llu\n  CELLs     %s, %s planes (%s)\n"
      "  a plane   %.2f B of %s of records\n",
      file.c_str(), human_bytes(double(bytes)).c_str(), map.name.c_str(),
      static_cast<unsigned long long>(map.revision), with_commas(map.cells).c_str(),
      with_commas(map.planes).c_str(), encoding.c_str(),
      map.planes ? double(map.stored_bytes) / double(map.planes) : 0.0,
      human_bytes(double(map.stored_bytes)).c_str());
}

client::Json summary_json(const std::string& file, const MapInfo& map, std::uint64_t bytes,
                          const ArchiveFooter& footer) {
  return {{"file", file},
          {"bytes", bytes},
          {"encoding", to_string(footer.encoding)},
          {"bound_m", footer.bound_m},
          {"map", client::to_json(map)}};
}

/// A file beside the one to be written, which takes its place when it is whole.
template <typename Write>
void write_whole(const std::string& file, const Write& write) {
  const std::string part = file + ".part";
  try {
    write(part);
    std::filesystem::rename(part, file);
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove(part, ignored);
    throw;
  }
}

ArchiveOptions archive_options(const ArchiveArguments& options) {
  const auto form = options.form.form();
  if (!form) return default_archive_options(open_reader(options.place)->map(options.map));
  ArchiveOptions wanted;
  wanted.encoding = form->encoding;
  if (!form->is_exact()) wanted.bound_m = form->bound_m();
  return wanted;
}

void write_archive(const ArchiveArguments& options, const Console& console) {
  const ArchiveOptions wanted = archive_options(options);
  if (options.place.store.empty()) {
    const Interrupt interrupt;
    ProgressBar bar(console, "archive");
    write_whole(options.file, [&](const std::string& part) {
      const auto file = open_file(part, FileMode::kCreate);
      download_archive(
          client_options_of(options.place), options.map, wanted, *file, interrupt.token(),
          [&](std::uint64_t done, std::uint64_t total) { bar.update(done, total, "bytes"); });
    });
    return;
  }
  const auto store = open_existing_store(options.place.store);
  const std::uint64_t cells = store->map(options.map).cells;
  const Interrupt interrupt;
  ProgressBar bar(console, "archive");
  write_whole(options.file, [&](const std::string& part) {
    const auto file = open_file(part, FileMode::kCreate);
    archive_map(*store, options.map, *file, wanted, interrupt.token(),
                [&](const Progress& done) { bar.update(done.cells_done, cells, "CELLs"); });
  });
}

/// Throws where a CELL of the archive is another one by now: its map was converted.
void require_same_cells(const std::string& file, const std::vector<CellRecord>& of_map) {
  ArchiveReader archive(open_file(file, FileMode::kRead));
  std::map<CellId, ContentHash> hashes;
  for (const CellRecord& record : of_map) hashes[record.id] = record.hash;
  for (const ArchivedCell& listed : archive.cells()) {
    const auto now = hashes.find(listed.id);
    if (now == hashes.end() || now->second == listed.hash) continue;  // the pose graph says more
    // A map that keeps CELLs compact names them by what they decode to.
    if (encode_cell(archive.cell(listed.id).cell).hash == now->second) continue;
    throw Error(ErrorCode::kConflict, "CELL " + std::to_string(listed.id.value) + " of '" + file +
                                          "' is another one in the map by now; archive it anew");
  }
}

void archive(const ArchiveArguments& options, const Console& console) {
  std::uint64_t written = 0;
  if (options.update) {
    const auto map = open_reader(options.place);
    const PoseGraph graph = map->pose_graph(options.map);
    require_same_cells(options.file, map->all_cells(options.map));
    written = update_archive(*open_file(options.file, FileMode::kUpdate), graph);
  } else {
    write_archive(options, console);
  }
  ArchiveReader reader(open_file(options.file, FileMode::kRead));
  const MapInfo map = map_info(reader);
  const std::uint64_t bytes = reader.source().size();
  client::Json json = summary_json(options.file, map, bytes, reader.footer());
  std::string text = summary(options.file, map, bytes, reader.footer());
  if (options.update) {
    json["written_bytes"] = written;
    text += format("  written   %s, %.2f %% of the file\n", human_bytes(double(written)).c_str(),
                   100.0 * double(written) / double(bytes));
  }
  console.print(json, text);
}

MapInfo restore_in_store(const ArchiveArguments& options, ArchiveReader& reader,
                         const std::string& name, const Console& console) {
  const auto store = open_store(options.place.store, objects_of_environment());
  const Interrupt interrupt;
  ProgressBar bar(console, "restore");
  return restore_map(reader, *store, name, interrupt.token(), [&](const Progress& done) {
    bar.update(done.cells_done, reader.head().cells, "CELLs");
  });
}

void restore(const ArchiveArguments& options, const Console& console) {
  ArchiveReader reader(open_bytes(options.file, options.place));
  const std::string name = options.map.empty() ? reader.footer().map : options.map;
  const MapInfo map = options.place.store.empty()
                          ? upload_archive(client_options_of(options.place), name, reader.source())
                          : restore_in_store(options, reader, name, console);
  console.print(client::to_json(map), map_text(map));
}

}  // namespace

void add_archive(CLI::App& app, Verbs& verbs) {
  const auto archived = std::make_shared<ArchiveArguments>();
  CLI::App* verb = verbs.add(
      app, "archive", "Write a whole map into one file",
      "  cellmap archive town --store map.db --out town.cellmap\n"
      "  cellmap archive town --server URL --encoding compact --bound 20mm --out town.cellmap\n"
      "  cellmap archive town --store map.db --out town.cellmap --update\n"
      "packed keeps every bit; compact moves no point of a plane by more than the bound, and is "
      "copied\nwhere the map keeps its CELLs so.\n"
      "Read it with --archive, from a file or from any web server: 'cellmap relocalise'.\n",
      [archived](const Console& console) { archive(*archived, console); });
  verb->add_option("MAP", archived->map, "Name of the map")->required();
  verb->add_option("--out", archived->file, "File to write")->required();
  add_form_flags(*verb, archived->form,
                 "How CELLs are archived; without it packed, or compact as the map keeps them");
  verb->add_flag("--update", archived->update,
                 "Only bring poses and constraints of the file up to date");
  add_place_options(*verb, archived->place, true);

  const auto restored = std::make_shared<ArchiveArguments>();
  CLI::App* back = verbs.add(app, "restore", "Make a map of an archive; every hash is verified",
                             "  cellmap restore town.cellmap --store map.db\n"
                             "  cellmap restore town.cellmap --server URL --map town2\n",
                             [restored](const Console& console) { restore(*restored, console); });
  back->add_option("FILE", restored->file, "The archive, or its http:// address")->required();
  back->add_option("--map", restored->map, "Name of the new map (default: as it was)");
  add_place_options(*back, restored->place, true);
}

}  // namespace cellmap::cli
