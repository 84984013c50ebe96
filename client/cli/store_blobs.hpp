#pragma once

#include <optional>

#include "cellmap/store/object_store.hpp"

namespace cellmap::cli {

/// Where the databases that a verb opens have the bytes of their CELLs, as the environment says:
/// CELLMAP_BLOBS (s3://BUCKET[/PREFIX]), CELLMAP_BLOBS_ENDPOINT, CELLMAP_BLOBS_REGION and AWS's
/// keys. nullopt: in themselves.
std::optional<ObjectStoreOptions> objects_of_environment();

}  // namespace cellmap::cli
