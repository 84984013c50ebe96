#include "cellmap/codec/cell_batch.hpp"

#include <algorithm>
#include <set>
#include <unordered_set>

#include "cellmap/core/error.hpp"
#include "cellmap/store/read_cell.hpp"
#include "server/api/api.hpp"
#include "server/api/coded_cells.hpp"
#include "server/api/conditions.hpp"
#include "server/api/problem.hpp"

// POST /v1/maps/{map}/cells:batch.

namespace cellmap::server {
namespace {

constexpr const char* kCellsType = "application/vnd.cellmap.cells";
constexpr std::size_t kMaxBatchBody = 8u << 20;
constexpr std::size_t kMaxAnswer = 64u << 20;

struct Batch {
  std::vector<CellId> ids;  ///< ascending, before the limit
  std::size_t limit = 64;
};

/// The CELLs of a map that `wanted` accepts.
std::vector<CellId> select(const Store& store, const std::string& map, Revision since,
                           const std::function<bool(const CellRecord&)>& wanted) {
  std::vector<CellId> ids;
  CellQuery query;
  query.since = since;
  query.limit = 10'000;
  do {
    const CellPage page = store.cells(map, query);
    for (const auto& cell : page.cells) {
      if (wanted(cell)) ids.push_back(cell.id);
    }
    query.cursor = page.next_cursor;
  } while (!query.cursor.empty());
  return ids;
}

std::vector<CellId> read_ids(const Json& array) {
  std::set<CellId> ids;
  for (const auto& element : array) {
    if (!element.is_number_unsigned() || element.get<std::uint64_t>() > UINT32_MAX) {
      throw Error(ErrorCode::kInvalidArgument,
                  "Expected 'ids' to be integers from 0 to 4294967295.");
    }
    ids.insert(CellId{element.get<std::uint32_t>()});
  }
  return {ids.begin(), ids.end()};
}

std::set<ContentHash> read_hashes(const Json& array) {
  std::set<ContentHash> hashes;
  for (const auto& element : array) {
    if (!element.is_string()) {
      throw Error(ErrorCode::kInvalidArgument, "Expected 'have' to be hashes of 64 digits.");
    }
    hashes.insert(content_hash_from_hex(element.get<std::string>()));
  }
  return hashes;
}

Batch read_batch(const Store& store, const std::string& map, const Json& json) {
  ObjectReader reader(json, "the batch");
  const Json* ids = reader.array("ids", 10'000);
  const auto since = reader.integer("since", INT64_MAX);
  const Json* have = reader.array("have", 100'000);
  Batch batch;
  if (const auto limit = reader.integer("limit", 256)) batch.limit = *limit;
  reader.finish();
  if ((ids != nullptr) + since.has_value() + (have != nullptr) != 1 || batch.limit == 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "Expected exactly one of 'ids', 'since' and 'have', and a limit of 1 to 256.");
  }
  if (ids) {
    batch.ids = read_ids(*ids);
  } else if (since) {
    batch.ids = select(store, map, *since, [&](const auto& cell) { return cell.added > *since; });
  } else {
    const auto hashes = read_hashes(*have);
    batch.ids = select(store, map, 0, [&](const auto& c) { return !hashes.contains(c.hash); });
  }
  return batch;
}

Response batch_cells(Services& services, CodedCells& coded_cells, const Call& call) {
  constexpr std::array<std::string_view, 2> types{kCellsType, kCodedCellsType};
  const auto type = negotiate(call.header("Accept"), types);
  if (!type) return not_acceptable(types);
  std::optional<CodedForm> form;
  if (*type == kCodedCellsType) form = coded_form(*call.header("Accept"), *type);
  // Of a batch all bytes of each CELL are sent: a coarse reader cannot tell where a file would end.
  if (form && form->is_coarse) {
    throw Error(ErrorCode::kInvalidArgument,
                "Batches have whole CELLs: ask for coarse layers one by one.");
  }
  std::optional<CodedForm> sent_form;  // with the widest bound of all
  const auto& map = call.path("map");
  const Revision revision = services.store.map(map).revision;
  const Batch asked = read_batch(services.store, map, call.json());
  Bytes batch;
  std::size_t sent = 0;
  for (; sent < std::min(asked.ids.size(), asked.limit); ++sent) {
    const CellId id = asked.ids[sent];
    Bytes bytes;
    if (form) {
      const CodedCells::Coded coded = coded_cells.get(map, id, *form);
      bytes = *coded.bytes;
      if (!sent_form || sent_form->bound_m < coded.form.bound_m) sent_form = coded.form;
    } else {
      bytes = read_encoded_cell(services.store, map, id).bytes;
    }
    if (!batch.empty() && batch.size() + bytes.size() > kMaxAnswer) break;
    append_to_batch(batch, id, bytes);
  }
  Response response;
  response.headers.set("Content-Type",
                       std::string(*type) + (form ? to_parameters(sent_form.value_or(*form)) : ""));
  response.headers.set("CELLmap-Revision", std::to_string(revision));
  if (sent < asked.ids.size()) {
    response.headers.set("CELLmap-Remaining", std::to_string(asked.ids.size() - sent));
  }
  const std::size_t size = batch.size();
  response.body = SharedBytes{std::make_shared<const Bytes>(std::move(batch)), 0, size};
  return response;
}

}  // namespace

void add_cell_batch_route(Router& router, Services& services) {
  router.add({"POST",
              "/v1/maps/{map}/cells:batch",
              {},
              kMaxBatchBody,
              {},
              [&services, coded_cells = std::make_shared<CodedCells>(services.store)](
                  const Call& call) { return batch_cells(services, *coded_cells, call); }});
}

}  // namespace cellmap::server
