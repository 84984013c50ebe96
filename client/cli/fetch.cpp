#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/client/coded_cells.hpp"
#include "cellmap/client/files.hpp"
#include "client/cli/client_options.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/form_flags.hpp"
#include "client/cli/map_reader.hpp"

namespace cellmap::cli {
namespace {

struct FetchArguments {
  Place place;
  std::string map, out;
  std::uint32_t cell = 0;
  FormFlags form;
  bool is_coarse = false;
};

/// One CELL in few bytes, as they came.
void fetch_coded(const FetchArguments& options, const CodedCellForm& form, const Console& console) {
  if (options.place.is_offline()) {
    throw Error(ErrorCode::kInvalidArgument,
                "--encoding packed, --encoding compact and --coarse need a --server");
  }
  CodedCellReader reader(client_options_of(options.place));
  const CellId id{options.cell};
  const FetchedCodedCell fetched = options.is_coarse ? reader.coarse_cell(options.map, id, form)
                                                     : reader.cell(options.map, id, form);
  if (!options.out.empty()) client::write_file_atomically(options.out, fetched.bytes);
  const DecodedCell& decoded = fetched.decoded;
  // Where the map keeps it compact, whatever was asked for within that bound.
  const std::string encoding = decoded.encoding == CellEncoding::kPacked ? "packed" : "compact";
  client::Json json = {{"id", id.value},
                       {"hash", to_hex(decoded.hash)},
                       {"raw_hash", to_hex(decoded.raw_hash)},
                       {"encoding", encoding},
                       {"bound_m", decoded.bound_m},
                       {"session", decoded.cell.session},
                       {"sequence", decoded.cell.sequence},
                       {"planes", decoded.cell.planes.size()},
                       {"all_planes", decoded.all_planes},
                       {"bytes", fetched.bytes.size()},
                       {"all_bytes", fetched.file_bytes}};
  if (!options.out.empty()) json["file"] = options.out;
  std::string text = format(
      "CELL %u of %s, %s: %s of %s planes, %s of %s\n  hash %s\n", id.value, options.map.c_str(),
      encoding.c_str(), with_commas(decoded.cell.planes.size()).c_str(),
      with_commas(decoded.all_planes).c_str(), human_bytes(double(fetched.bytes.size())).c_str(),
      human_bytes(double(fetched.file_bytes)).c_str(), to_hex(decoded.hash).c_str());
  if (!options.out.empty()) text += "  written to " + options.out + "\n";
  console.print(json, text);
}

/// Without a server there is no cache, and nothing to save.
FetchedCell fetch_offline(const FetchArguments& options) {
  const auto reader = open_reader(options.place);
  for (const CellRecord& record : reader->all_cells(options.map)) {
    if (record.id.value != options.cell) continue;
    const Revision revision = reader->pose_graph(options.map).revision;
    return {record.id, reader->cell(options.map, record), record.T_map_cell, revision, false};
  }
  throw Error(ErrorCode::kNotFound,
              "map '" + options.map + "' has no CELL " + std::to_string(options.cell));
}

void fetch(const FetchArguments& options, const Console& console) {
  const CellForm form = options.form.form().value_or(CellForm{});
  if (form.encoding != KeptEncoding::kRaw) {
    return fetch_coded(options, coded_form_of(form), console);
  }
  if (options.is_coarse) {
    throw Error(ErrorCode::kInvalidArgument, "--coarse needs --encoding packed or compact");
  }
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
  const auto fetched = std::make_shared<FetchArguments>();
  CLI::App* one = verbs.add(app, "fetch", "Fetch and verify one CELL",
                            "  cellmap fetch town 12 --server http://127.0.0.1:8080 --out 12.cell\n"
                            "  cellmap fetch town 12 --server URL --cache ~/.cache/cellmap\n"
                            "  cellmap fetch town 12 --server URL --encoding compact --bound 10mm\n"
                            "  cellmap fetch town 12 --archive https://HOST/town.cellmap\n",
                            [fetched](const Console& console) { fetch(*fetched, console); });
  one->add_option("MAP", fetched->map, "Name of the map")->required();
  one->add_option("CELL", fetched->cell, "Number of the CELL")->required();
  one->add_option("--out", fetched->out, "File for its bytes (FlatBuffers)");
  add_form_flags(*one, fetched->form, "In which form it comes; without it raw");
  one->add_flag("--coarse", fetched->is_coarse,
                "Of a packed or compact CELL its first bytes alone: a quarter of the planes");
  add_place_options(*one, fetched->place, true, true);
}

}  // namespace cellmap::cli
