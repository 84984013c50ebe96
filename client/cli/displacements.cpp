#include "client/cli/displacements.hpp"

#include <algorithm>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/error.hpp"
#include "client/cli/console.hpp"

namespace cellmap::cli {

void Displacements::add(const Cell& cell, const ContentHash& source_hash, double cell_bound_m,
                        const Cell& source) {
  // In the library's layout, as the hash of a source is.
  const ContentHash hash = encode_cell(source).hash;
  if (encode_cell(cell).hash == hash) {
    ++equal;  // also a compact CELL against a map that keeps it so
    return;
  }
  if (source_hash != hash) {
    ++different;
    return;
  }
  cells.push_back(cell_displacement(source, cell));
  bound_m = std::max(bound_m, cell_bound_m);
  is_bound_kept = is_bound_kept && cells.back().worst_m <= cell_bound_m;
}

double Displacements::worst_m() const {
  double worst = 0;
  for (const CellDisplacement& cell : cells) worst = std::max(worst, cell.worst_m);
  return worst;
}

double Displacements::median(double CellDisplacement::*figure) const {
  std::vector<double> values;
  for (const CellDisplacement& cell : cells) values.push_back(cell.*figure);
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

nlohmann::json to_json(const Displacements& found) {
  nlohmann::json json = {{"equal", found.equal}, {"different", found.different}};
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

void require_kept(const Displacements& found, const std::string& what) {
  if (found.different > 0) {
    throw Error(ErrorCode::kCorruptData, what + " is not of this source");
  }
  if (!found.is_bound_kept) throw Error(ErrorCode::kCorruptData, "the bound is broken");
}

}  // namespace cellmap::cli
