#include "client/cli/record_query.hpp"

#include <algorithm>
#include <charconv>

#include "cellmap/core/error.hpp"

namespace cellmap::cli {
namespace {

bool matches(const CellRecord& cell, const CellQuery& query) {
  const Eigen::Vector3d position = cell.T_map_cell.translation();
  return (!query.near || (position - *query.near).norm() <= query.radius_m) &&
         (!query.box || query.box->contains(position)) &&
         (!query.session || cell.session == *query.session) &&
         std::max(cell.added, cell.moved) > query.since;
}

std::size_t begin_of(const CellQuery& query) {
  std::size_t begin = 0;
  const char* const end = query.cursor.data() + query.cursor.size();
  if (!query.cursor.empty() && std::from_chars(query.cursor.data(), end, begin).ptr != end) {
    throw Error(ErrorCode::kInvalidArgument, "the cursor is not one of these CELLs'");
  }
  return begin;
}

}  // namespace

CellPage page_of(std::vector<CellRecord> records, Revision revision, const CellQuery& query) {
  std::erase_if(records, [&](const CellRecord& cell) { return !matches(cell, query); });
  if (query.near) {
    std::ranges::stable_sort(records, {}, [&](const CellRecord& cell) {
      return (cell.T_map_cell.translation() - *query.near).squaredNorm();
    });
  }
  const std::size_t begin = std::min(begin_of(query), records.size());
  const std::size_t end = begin + std::min(query.limit, records.size() - begin);
  CellPage page;
  page.revision = revision;
  page.cells.assign(records.begin() + static_cast<std::ptrdiff_t>(begin),
                    records.begin() + static_cast<std::ptrdiff_t>(end));
  if (end < records.size()) page.next_cursor = std::to_string(end);
  return page;
}

}  // namespace cellmap::cli
