#pragma once

#include <stop_token>
#include <string>

#include "cellmap/codec/cell_form.hpp"
#include "server/api/json_io.hpp"
#include "server/api/map_state.hpp"
#include "server/jobs/ingest.hpp"

namespace cellmap::server {

/// The form that a map is to be brought into: {"encoding": "compact", "bound_m": 0.02}. Throws
/// Error{kInvalidArgument}.
CellForm parse_convert_request(const Json& json);

/// Brings a map into a form CELL by CELL (`convert_cells`), beside whoever else writes to it.
/// Stopped anywhere it goes on when it is run again. Throws Error{kCancelled} when stopped, and
/// what `convert_cells` throws. `store` as in `run_ingest`.
void run_convert(Maps& maps, Store& store, const std::string& map, const CellForm& form,
                 const std::stop_token& stop, const IngestHooks& hooks);

}  // namespace cellmap::server
