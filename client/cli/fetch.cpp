#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/client/files.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/map_reader.hpp"

namespace cellmap::cli {
namespace {

struct Options {
  Place place;
  std::string map, out;
  std::uint32_t cell = 0;
};

/// Without a server there is no cache, and nothing to save.
FetchedCell fetch_offline(const Options& options) {
  const auto reader = open_reader(options.place);
  for (const CellRecord& record : reader->all_cells(options.map)) {
    if (record.id.value != options.cell) continue;
    const Revision revision = reader->pose_graph(options.map).revision;
    return {record.id, reader->cell(options.map, record), record.T_map_cell, revision, false};
  }
  throw Error(ErrorCode::kNotFound,
              "map '" + options.map + "' has no CELL " + std::to_string(options.cell));
}

void fetch(const Options& options, const Console& console) {
  const FetchedCell fetched = options.place.is_offline()
                                  ? fetch_offline(options)
                                  : connect(options.place).cell(options.map, CellId{options.cell});
  const Cell cell = decode_cell(fetched.encoded.bytes);
  if (!options.out.empty()) client::write_file_atomically(options.out, fetched.encoded.bytes);
  client::Json json = {{"id", fetched.id.value},
                       {"hash", to_hex(fetched.encoded.hash)},
                       {"pose", client::to_json(fetched.T_map_cell)},
                       {"revision", fetched.revision},
                       {"session", cell.session},
                       {"sequence", cell.sequence},
                       {"planes", cell.planes.size()},
                       {"bytes", fetched.encoded.bytes.size()},
                       {"from_cache", fetched.from_cache}};
  if (!options.out.empty()) json["file"] = options.out;
  std::string text =
      format("CELL %u of %s: %s planes, %s%s\n  hash %s\n  session %s, number %u\n",
             fetched.id.value, options.map.c_str(), with_commas(cell.planes.size()).c_str(),
             human_bytes(double(fetched.encoded.bytes.size())).c_str(),
             fetched.from_cache ? ", from the cache (304)" : "",
             to_hex(fetched.encoded.hash).c_str(), cell.session.c_str(), cell.sequence);
  if (!options.out.empty()) text += "  written to " + options.out + "\n";
  console.print(json, text);
}

}  // namespace

void add_fetch(CLI::App& app, Verbs& verbs) {
  const auto fetched = std::make_shared<Options>();
  CLI::App* one = verbs.add(app, "fetch", "Fetch and verify one CELL",
                            "  cellmap fetch town 12 --server http://127.0.0.1:8080 --out 12.cell\n"
                            "  cellmap fetch town 12 --server URL --cache ~/.cache/cellmap\n"
                            "  cellmap fetch town 12 --archive https://HOST/town.cellmap\n",
                            [fetched](const Console& console) { fetch(*fetched, console); });
  one->add_option("MAP", fetched->map, "Name of the map")->required();
  one->add_option("CELL", fetched->cell, "Number of the CELL")->required();
  one->add_option("--out", fetched->out, "File for its bytes (FlatBuffers)");
  add_place_options(*one, fetched->place, true, true);
}

}  // namespace cellmap::cli
