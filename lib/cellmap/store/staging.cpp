#include "cellmap/store/staging.hpp"

#include "cellmap/core/error.hpp"

namespace cellmap {

Staging& staging_of(Store& store) {
  if (auto* staging = dynamic_cast<Staging*>(&store)) return *staging;
  throw Error(ErrorCode::kUnsupported, "this store cannot make a map out of sight");
}

StagedMap::StagedMap(Store& store, const LatticeSpec& lattice, std::string to_be)
    : store_(store), to_be_(std::move(to_be)) {
  validate_map_name(to_be_);
  try {
    store_.version(to_be_);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kNotFound) throw;
    name_ = staging_of(store_).stage_map(lattice);
    return;
  }
  throw Error(ErrorCode::kAlreadyExists, "there is a map named '" + to_be_ + "' already");
}

StagedMap::~StagedMap() {
  if (published_) return;
  try {
    store_.delete_map(name_);
  } catch (const Error&) {  // the first failure is the one to tell; the next start deletes it
  }
}

MapInfo StagedMap::publish(const std::optional<Staging::Along>& along) {
  staging_of(store_).publish_map(name_, to_be_, along);
  published_ = true;
  return store_.map(to_be_);
}

}  // namespace cellmap
