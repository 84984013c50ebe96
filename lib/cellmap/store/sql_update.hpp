#pragma once

#include <string>
#include <vector>

#include "cellmap/store/sql_connection.hpp"
#include "cellmap/store/sql_reads.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

/// zstd frames of the kept bytes of an update, in the order of its CELLs.
struct UpdateFrames {
  std::vector<Bytes> cells, recoded;
  bool are_objects = false;  ///< they were put (store/blobs.hpp); rows only say so
};
/// Carries out an update as one new revision. Expects to run inside one transaction to which nobody
/// else writes the map, whose row is given; the caller commits it, or rolls it back where this
/// throws. The update has been validated.
CommitResult apply_update(SqlConnection& connection, const MapRow& map, const MapUpdate& update,
                          const UpdateFrames& frames);

}  // namespace cellmap
