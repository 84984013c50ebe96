#pragma once

#include <string>
#include <vector>

#include "cellmap/store/sql_connection.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

/// zstd frames of the kept bytes of an update, in the order of its CELLs.
struct UpdateFrames {
  std::vector<Bytes> cells, recoded;
  bool are_objects = false;  ///< they were put (store/blobs.hpp); rows only say so
};
/// Carries out an update as one new revision. Expects to run inside one transaction that the caller
/// commits, or rolls back where this throws. The update has been validated.
CommitResult apply_update(SqlConnection& connection, const std::string& map,
                          const MapUpdate& update, const UpdateFrames& frames);

}  // namespace cellmap
