#pragma once

#include <set>
#include <stop_token>
#include <string>

#include "cellmap/pipeline/mapper_options.hpp"
#include "server/api/json_io.hpp"
#include "server/api/map_state.hpp"
#include "server/jobs/ingest.hpp"

namespace cellmap::server {

/// What a merge job was asked to do.
struct MergeRequest {
  std::string from;                ///< the map whose sessions are copied
  std::set<std::string> sessions;  ///< of them; empty: all
  MapperOptions options;
};

/// Throws Error{kInvalidArgument}.
MergeRequest parse_merge_request(const Json& json);

/// Copies sessions of another map into `map`; then looks for every CELL of them in the rest of the
/// map, as if it had just arrived, so that the islands join it and loops are closed. Each step is
/// one transaction: a merge that was stopped is made again and goes on. What finds no place stays
/// an island. `store` as in `run_ingest`. Throws Error{kCancelled} when stopped, and what
/// `copy_sessions` and the back end throw.
void run_merge(Maps& maps, Store& store, const std::string& map, const MergeRequest& request,
               const std::stop_token& stop, const IngestHooks& hooks);

}  // namespace cellmap::server
