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
#include "cellmap/codec/plane_displacement.hpp"
#include "client/cli/archive_reader.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/map_reader.hpp"

// verify and repair.

namespace cellmap::cli {
namespace {

struct Options {
  Place place;
  std::string file, source, map, out;
};

/// Over the CELLs of an archive.
struct Displacements {
  std::vector<CellDisplacement> cells;
  std::uint64_t equal = 0;      ///< CELLs with every bit of their source's
  std::uint64_t different = 0;  ///< CELLs that are not of the source at all
  double bound_m = 0;

  void add(const ArchiveCell& cell, const EncodedCell& source) {
    if (cell.raw_hash != source.hash) {
      ++different;
      return;
    }
    if (cell.bound_m == 0) {
      ++equal;  // the hash is that of the decoded CELL
      return;
    }
    bound_m = cell.bound_m;
    cells.push_back(cell_displacement(decode_cell(source.bytes), cell.cell));
  }

  double worst_m() const {
    double worst = 0;
    for (const CellDisplacement& cell : cells) worst = std::max(worst, cell.worst_m);
    return worst;
  }
  /// The median over CELLs of a figure that each has over its planes.
  double median(double CellDisplacement::*figure) const {
    std::vector<double> values;
    for (const CellDisplacement& cell : cells) values.push_back(cell.*figure);
    if (values.empty()) return 0;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  }
  bool is_bound_kept() const { return worst_m() <= bound_m; }
};

client::Json to_json(const Displacements& found) {
  client::Json json = {{"equal", found.equal}, {"different", found.different}};
  if (!found.cells.empty()) {
    json["bound_m"] = found.bound_m;
    json["worst_m"] = found.worst_m();
    json["p99_m"] = found.median(&CellDisplacement::p99_m);
    json["median_m"] = found.median(&CellDisplacement::median_m);
  }
  return json;
}

std::string to_text(const Displacements& found) {
  std::string text;
  if (found.equal > 0)
    text += format("  source    %s CELLs, every bit\n", with_commas(found.equal).c_str());
  if (!found.cells.empty()) {
    text += format(
        "  source    %s CELLs within %.3f mm: worst %.3f mm, p99 %.3f mm, median %.3f mm (p99 and "
        "median of a CELL's planes, median over CELLs)\n",
        with_commas(found.cells.size()).c_str(), found.bound_m * 1e3, found.worst_m() * 1e3,
        found.median(&CellDisplacement::p99_m) * 1e3,
        found.median(&CellDisplacement::median_m) * 1e3);
  }
  if (found.different > 0) {
    text += format("  source    %s CELLs are not of this source\n",
                   with_commas(found.different).c_str());
  }
  return text;
}

[[noreturn]] void fail(const std::string& what) { throw Error(ErrorCode::kCorruptData, what); }

/// Looks up CELLs in the map that an archive was made of.
class Source {
 public:
  Source(const Options& options, const std::string& map) : map_(map) {
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

void verify_archive_file(const Options& options, const Console& console) {
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
    raw ? displacements.add(cell, *raw) : void(++displacements.different);
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
  if (displacements.different > 0) fail("the archive is not of this source");
  if (!displacements.is_bound_kept()) fail("the bound is broken");
}

Bytes read_all(const std::string& file) {
  auto bytes = client::read_file(file, std::max(kMaxCodedCellBytes, kMaxCellBytes));
  if (!bytes) throw Error(ErrorCode::kNotFound, "there is no file '" + file + "'");
  return *std::move(bytes);
}

void verify_cell_file(const Options& options, const Console& console) {
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
    const Bytes raw = read_all(options.source);
    const ArchiveCell cell{
        .id = {}, .raw_hash = decoded.raw_hash, .bound_m = decoded.bound_m, .cell = decoded.cell};
    // In the library's layout, as the raw hash is.
    displacements.add(cell, encode_cell(decode_cell(raw)));
    json["source"] = to_json(displacements);
    text += to_text(displacements);
  }
  console.print(json, text);
  if (displacements.different > 0) fail("the CELL was not coded from '" + options.source + "'");
  if (!displacements.is_bound_kept()) fail("the bound is broken");
}

void verify(const Options& options, const Console& console) {
  const Bytes begin = open_bytes(options.file, options.place)->read(0, 8);
  const std::string_view text = client::as_text(begin);
  if (text.size() == 8 && text.substr(4) == "CCOD") return verify_cell_file(options, console);
  verify_archive_file(options, console);
}

void repair(const Options& options, const Console& console) {
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
  const auto verified = std::make_shared<Options>();
  CLI::App* verb = verbs.add(app, "verify", "Check every byte of an archive, or a coded CELL",
                             "  cellmap verify town.cellmap\n"
                             "  cellmap verify town.cellmap --source map.db\n"
                             "  cellmap verify 12.ccod --source 12.cell\n"
                             "With --source: how far planes are from those that were archived.\n",
                             [verified](const Console& console) { verify(*verified, console); });
  verb->add_option("FILE", verified->file, "An archive, or its http:// address; a coded CELL")
      ->required();
  verb->add_option("--source", verified->source,
                   "Store file or server with the map, or the CELL that was coded");
  verb->add_option("--map", verified->map, "Its name there (default: as the archive says)");

  const auto repaired = std::make_shared<Options>();
  CLI::App* mend =
      verbs.add(app, "repair", "Write a new archive of what is intact in a damaged one",
                "  cellmap repair cut-off.cellmap --out town.cellmap\n",
                [repaired](const Console& console) { repair(*repaired, console); });
  mend->add_option("FILE", repaired->file, "The damaged archive, which stays as it is")->required();
  mend->add_option("--out", repaired->out, "File to write")->required();
}

}  // namespace cellmap::cli
