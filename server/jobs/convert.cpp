#include "server/jobs/convert.hpp"

#include <mutex>

#include "cellmap/core/error.hpp"
#include "cellmap/store/convert_cells.hpp"

namespace cellmap::server {

CellForm parse_convert_request(const Json& json) {
  ObjectReader reader(json, "the conversion");
  const auto form = read_form(reader);
  reader.finish();
  if (!form) {
    throw Error(ErrorCode::kInvalidArgument, "Expected 'encoding': raw, packed or compact.");
  }
  return *form;
}

void run_convert(Maps& maps, Store& store, const std::string& map, const CellForm& form,
                 const std::stop_token& stop, const IngestHooks& hooks) {
  const auto state = maps.open(map);
  const AroundCommit around = [&](const std::function<void()>& commit) {
    const std::lock_guard lock(state->writer());
    commit();
  };
  convert_cells(store, map, form, stop, hooks.progress, around);
}

}  // namespace cellmap::server
