#include "cellmap/core/checksum.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/sql_cells.hpp"
#include "cellmap/store/sql_reads.hpp"
#include "cellmap/store/sql_store.hpp"

// What an SqlStore keeps of CELLs so that it need not be made again.

namespace cellmap {
namespace {

struct CellRun {
  CellId first, last;
};

/// Runs of numbers that are nearly consecutive, as those of a drive's CELLs in one region are: one
/// query for each is less than one for each CELL.
std::vector<CellRun> runs_of(std::span<const CellId> cells) {
  constexpr std::uint32_t kMostLeftOut = 4;
  std::vector<CellRun> runs;
  for (const CellId id : cells) {
    if (runs.empty() || id.value - runs.back().last.value > kMostLeftOut) {
      runs.push_back({id, id});
    } else {
      runs.back().last = id;
    }
  }
  return runs;
}

std::int64_t checksum_of(std::span<const std::byte> bytes) {
  return static_cast<std::int64_t>(checksum(bytes));
}

}  // namespace

Descriptions& descriptions_of(Store& store) {
  if (auto* descriptions = dynamic_cast<Descriptions*>(&store)) return *descriptions;
  throw Error(ErrorCode::kUnsupported, "this store keeps no descriptions of CELLs");
}

std::vector<CellDescription> SqlStore::descriptions(const std::string& map,
                                                    std::span<const CellId> cells) const {
  std::vector<CellDescription> found;
  found.reserve(cells.size());
  database_->readers.read([&](SqlConnection& c) {
    const std::int64_t key = read_map_row(c, map).key;
    auto wanted = cells.begin();
    for (const CellRun& run : runs_of(cells)) {
      // Not a join: an engine that expects many rows would read all CELLs for it.
      Query row(c,
                "SELECT cell, hash, checksum, bytes FROM cell_description AS d WHERE map = ? AND "
                "cell BETWEEN ? AND ? AND hash = (SELECT COALESCE(identity, hash) FROM cell WHERE "
                "cell.map = d.map AND cell.id = d.cell) ORDER BY cell",
                key, run.first.value, run.last.value);
      while (row.next()) {
        const CellId id{row.unsigned32(0)};
        while (wanted != cells.end() && *wanted < id) ++wanted;
        if (wanted == cells.end() || *wanted != id) continue;
        const std::span<const std::byte> bytes = row.bytes(3);
        if (checksum_of(bytes) != row.integer(2)) continue;
        found.push_back({id, hash_from(row.bytes(1)), Bytes(bytes.begin(), bytes.end())});
      }
    }
  });
  return found;
}

void SqlStore::keep_descriptions(const std::string& map,
                                 const std::vector<CellDescription>& descriptions) {
  for (const CellDescription& one : descriptions) {
    if (one.bytes.size() > kMaxDescriptionBytes) {
      throw Error(ErrorCode::kTooLarge, "a description of a CELL is at most " +
                                            std::to_string(kMaxDescriptionBytes) +
                                            " bytes long, not " + std::to_string(one.bytes.size()));
    }
  }
  change_map(map, [&](SqlConnection& c, const MapRow& row) {
    for (const CellDescription& one : descriptions) {
      const auto raw = std::as_bytes(std::span(one.hash.bytes));
      const Bytes hash(raw.begin(), raw.end());
      Query(c,
            "INSERT INTO cell_description (map, cell, hash, checksum, bytes) SELECT map, id, ?, ?, "
            "? FROM cell WHERE map = ? AND id = ? AND COALESCE(identity, hash) = ? ON CONFLICT "
            "(map, cell) DO UPDATE SET hash = excluded.hash, checksum = excluded.checksum, bytes = "
            "excluded.bytes",
            hash, checksum_of(one.bytes), one.bytes, row.key, one.cell.value, hash)
          .run();
    }
  });
}

}  // namespace cellmap
