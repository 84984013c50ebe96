#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/archive/repair_archive.hpp"
#include "cellmap/archive/verify_archive.hpp"
#include "cellmap/client/files.hpp"
#include "cellmap/client/range_source.hpp"
#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/store/read_cell.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "client/cli/archive_reader.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/displacements.hpp"
#include "client/cli/map_reader.hpp"

// verify and repair.

namespace cellmap::cli {
namespace {

struct VerifyArguments {
  Place place;
  std::string file, source, map, out;
};

[[noreturn]] void fail(const std::string& what) { throw Error(ErrorCode::kCorruptData, what); }

/// Looks up CELLs in the map that an archive was made of.
class Source {
 public:
  Source(const VerifyArguments& options, const std::string& map) : map_(map) {
    Place place = options.place;
    place.server.clear();
    (is_http_url(options.source) ? place.server : place.store) = options.source;
    reader_ = open_reader(place);
    for (const CellRecord& record : reader_->all_cells(map_)) records_.emplace(record.id, record);
  }
  std::optional<EncodedCell> cell(CellId id) {
    const auto record = records_.find(id);
    if (record == records_.end()) return std::nullopt;
    return reader_->cell(map_, record->second);
  }

 private:
  std::string map_;
  std::unique_ptr<MapReader> reader_;
  std::map<CellId, CellRecord> records_;
};

void verify_archive_file(const VerifyArguments& options, const Console& console) {
  const auto bytes = open_bytes(options.file, options.place);
  std::optional<Source> source;
  Displacements displacements;
  if (!options.source.empty()) {
    const std::string map =
        options.map.empty() ? ArchiveReader(borrowed(*bytes)).footer().map : options.map;
    source.emplace(options, map);
  }
  const ArchiveReport report = verify_archive(*bytes, [&](const ArchiveCell& cell) {
    if (!source) return;
    const auto raw = source->cell(cell.id);
    raw ? displacements.add(cell.cell, cell.raw_hash, cell.bound_m, decode_cell(raw->bytes))
        : void(++displacements.different);
  });
  client::Json json = {{"file", options.file},    {"bytes", report.bytes},
                       {"cells", report.cells},   {"planes", report.planes},
                       {"damage", report.damage}, {"intact", report.damage.empty()}};
  std::string text = format("%s: %s, %s CELLs and %s planes intact\n", options.file.c_str(),
                            human_bytes(double(report.bytes)).c_str(),
                            with_commas(report.cells).c_str(), with_commas(report.planes).c_str());
  if (source) json["source"] = to_json(displacements);
  if (source) text += to_text(displacements);
  for (const std::string& finding : report.damage) text += "  damaged   " + finding + "\n";
  console.print(json, text);
  if (!report.damage.empty()) {
    fail("'" + options.file + "' is damaged; 'cellmap repair' recovers what is intact");
  }
  require_kept(displacements, "the archive");
}

Bytes read_all(const std::string& file) {
  auto bytes = client::read_file(file, std::max(kMaxCodedCellBytes, kMaxCellBytes));
  if (!bytes) throw Error(ErrorCode::kNotFound, "there is no file '" + file + "'");
  return *std::move(bytes);
}

void verify_cell_file(const VerifyArguments& options, const Console& console) {
  const DecodedCell decoded = decode_coded_cell(read_all(options.file));
  client::Json json = {{"file", options.file},
                       {"hash", to_hex(decoded.hash)},
                       {"raw_hash", to_hex(decoded.raw_hash)},
                       {"bound_m", decoded.bound_m},
                       {"planes", decoded.cell.planes.size()},
                       {"intact", true}};
  std::string text = format("%s: a coded CELL of %s planes, intact\n", options.file.c_str(),
                            with_commas(decoded.cell.planes.size()).c_str());
  Displacements displacements;
  if (!options.source.empty()) {
    const Cell source = decode_cell(read_all(options.source));
    displacements.add(decoded.cell, decoded.raw_hash, decoded.bound_m, source);
    json["source"] = to_json(displacements);
    text += to_text(displacements);
  }
  console.print(json, text);
  require_kept(displacements, "the CELL");
}

/// Every CELL of a map of a store, and with a source how far its planes are from that one's.
void verify_store_file(const VerifyArguments& options, const Console& console) {
  SqliteStoreOptions read_only;
  read_only.read_only = true;
  const auto store = open_sqlite_store(options.file, read_only);
  if (options.map.empty()) {
    throw Error(ErrorCode::kInvalidArgument, "a store holds many maps: name one with --map");
  }
  std::optional<Source> source;
  if (!options.source.empty()) source.emplace(options, options.map);
  Displacements displacements;
  std::uint64_t cells = 0, planes = 0;
  for (const CellKeeping& kept : store->keeping(options.map)) {
    const Cell cell = read_cell(*store, options.map, kept.id);
    ++cells;
    planes += cell.planes.size();
    if (!source) continue;
    const auto raw = source->cell(kept.id);
    raw ? displacements.add(cell, kept.source, kept.form.bound_m(), decode_cell(raw->bytes))
        : void(++displacements.different);
  }
  client::Json json = {
      {"file", options.file}, {"cells", cells}, {"planes", planes}, {"intact", true}};
  std::string text =
      format("%s: %s CELLs and %s planes of map %s intact\n", options.file.c_str(),
             with_commas(cells).c_str(), with_commas(planes).c_str(), options.map.c_str());
  if (source) json["source"] = to_json(displacements);
  if (source) text += to_text(displacements);
  console.print(json, text);
  require_kept(displacements, "the map");
}

void verify(const VerifyArguments& options, const Console& console) {
  const Bytes begin = open_bytes(options.file, options.place)->read(0, 8);
  const std::string_view text = client::as_text(begin);
  if (text == "SQLite f") return verify_store_file(options, console);
  if (text.size() == 8 && text.substr(4) == "CCOD") return verify_cell_file(options, console);
  verify_archive_file(options, console);
}

void repair(const VerifyArguments& options, const Console& console) {
  if (std::filesystem::exists(options.out)) {
    throw Error(ErrorCode::kAlreadyExists,
                "'" + options.out + "' is there already; repair writes a new file");
  }
  const auto damaged = open_file(options.file, FileMode::kRead);
  RepairReport report;
  try {
    report = repair_archive(*damaged, *open_file(options.out, FileMode::kCreate));
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove(options.out, ignored);
    throw;
  }
  std::string text =
      format("%s: %s of %s CELLs recovered\n", options.out.c_str(),
             with_commas(report.cells).c_str(), with_commas(report.cells_before).c_str());
  for (const std::string& note : report.notes) text += "  " + note + "\n";
  console.print({{"file", options.out},
                 {"cells", report.cells},
                 {"cells_before", report.cells_before},
                 {"bytes_skipped", report.bytes_skipped},
                 {"notes", report.notes}},
                text);
}

}  // namespace

void add_verify(CLI::App& app, Verbs& verbs) {
  const auto verified = std::make_shared<VerifyArguments>();
  CLI::App* verb =
      verbs.add(app, "verify", "Check every byte of an archive, the CELLs of a map, a coded CELL",
                "  cellmap verify town.cellmap\n"
                "  cellmap verify town.cellmap --source map.db\n"
                "  cellmap verify compact.db --map town --source raw.db\n"
                "  cellmap verify 12.ccod --source 12.cell\n"
                "With --source: how far planes are from those that were coded.\n",
                [verified](const Console& console) { verify(*verified, console); });
  verb->add_option("FILE", verified->file,
                   "An archive, or its http:// address; a store; a coded CELL")
      ->required();
  verb->add_option("--source", verified->source,
                   "Store file or server with the map, or the CELL that was coded");
  verb->add_option("--map", verified->map, "Its name there (default: as the archive says)");

  const auto repaired = std::make_shared<VerifyArguments>();
  CLI::App* mend =
      verbs.add(app, "repair", "Write a new archive of what is intact in a damaged one",
                "  cellmap repair cut-off.cellmap --out town.cellmap\n",
                [repaired](const Console& console) { repair(*repaired, console); });
  mend->add_option("FILE", repaired->file, "The damaged archive, which stays as it is")->required();
  mend->add_option("--out", repaired->out, "File to write")->required();
}

}  // namespace cellmap::cli
