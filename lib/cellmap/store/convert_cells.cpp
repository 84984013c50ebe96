#include "cellmap/store/convert_cells.hpp"

#include "cellmap/core/error.hpp"
#include "cellmap/store/read_cell.hpp"

namespace cellmap {
namespace {

/// A coarser form would add to the error of what is compact; an exact one is what it was.
bool stays(const CellForm& kept, const CellForm& form) { return kept == form || !kept.is_exact(); }

/// True where the CELL has another hash afterwards.
bool convert(Store& store, const std::string& map, CellId id, const CellForm& form,
             const AroundCommit& around) {
  KeptCell source = read_kept_cell(store, map, id);
  const ContentHash from = source.encoded.hash;
  // Raw bytes that came from elsewhere have a hash that no coding gives back.
  KeptCell kept = keep_cell(std::move(source.cell), form, std::move(source.encoded));
  const bool is_replaced = kept.encoded.hash != from;
  MapUpdate update;
  update.recoded[id] = {from, std::move(kept.encoded), std::move(kept.coded)};
  const auto commit = [&] { store.commit(map, update); };
  around ? around(commit) : commit();
  return is_replaced;
}

}  // namespace

void require_convertible(const MapInfo& map, const CellForm& form) {
  form.validate();
  for (const auto& [kept, cells] : map.kept) {
    if (kept.is_within(form)) continue;
    throw Error(ErrorCode::kConflict,
                "map " + map.name + " keeps " + std::to_string(cells) + " CELLs as '" +
                    to_string(kept) + "', which cannot become '" + to_string(form) +
                    "': what rounding took is gone; ask for a bound as wide, or build the map "
                    "anew");
  }
}

ConversionReport convert_cells(Store& store, const std::string& map, const CellForm& form,
                               const std::stop_token& stop, const ProgressCallback& progress,
                               const AroundCommit& around) {
  require_convertible(store.map(map), form);
  store.set_form(map, form);
  ConversionReport report;
  Progress done;
  for (const CellKeeping& cell : store.keeping(map)) {
    throw_if_stopped(stop);
    if (stays(cell.form, form)) {
      ++report.left;
    } else {
      report.replaced += convert(store, map, cell.id, form, around);
      ++report.converted;
    }
    ++done.cells_done;
    if (progress) progress(done);
  }
  return report;
}

}  // namespace cellmap
