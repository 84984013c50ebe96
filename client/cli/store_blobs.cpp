#include "client/cli/store_blobs.hpp"

#include <cstdlib>
#include <string>

namespace cellmap::cli {
namespace {

std::string value_of(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

std::optional<ObjectStoreOptions> objects_of_environment() {
  ObjectStoreOptions objects;
  objects.place = value_of("CELLMAP_BLOBS");
  if (objects.place.empty()) return std::nullopt;
  objects.endpoint = value_of("CELLMAP_BLOBS_ENDPOINT");
  const std::string region = value_of("CELLMAP_BLOBS_REGION");
  if (!region.empty()) objects.region = region;
  objects.take_keys_from_environment();
  return objects;
}

}  // namespace cellmap::cli
