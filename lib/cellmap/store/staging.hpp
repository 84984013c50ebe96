#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "cellmap/geometry/lattice.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

/// Maps in the making, for what takes many commits and is to be seen whole or not at all. A staged
/// map has a name that no map can have ("." and a number) and is not listed; by that name it is
/// written and read as any other. Those that a crash leaves are gone when the store is opened for
/// writing again. Durability, concurrency and errors as `Store`.
class Staging {
 public:
  virtual ~Staging() = default;

  /// An empty staged map; returns its name.
  virtual std::string stage_map(const LatticeSpec& lattice) = 0;

  /// What else happens in the transaction that publishes a map.
  struct Along {
    std::string map;
    MapUpdate update;
  };
  /// Gives a staged map its name and so makes it visible, in one transaction. Error{kAlreadyExists}
  /// where the name is taken, {kNotFound} where nothing is staged so, and what `Store::commit`
  /// throws for `along`; nothing changes then.
  virtual void publish_map(const std::string& staged, const std::string& name,
                           const std::optional<Along>& along = {}) = 0;
};

/// True for the name of a staged map.
inline bool is_staged(std::string_view name) { return name.starts_with('.'); }

/// The staging of a store. Throws Error{kUnsupported} for an engine that has none.
Staging& staging_of(Store& store);

/// A staged map that is deleted again unless it is published. The store must outlive it.
class StagedMap {
 public:
  /// Throws Error{kAlreadyExists} at once where the name `to_be` is taken already.
  StagedMap(Store& store, const LatticeSpec& lattice, std::string to_be);
  ~StagedMap();
  StagedMap(const StagedMap&) = delete;
  StagedMap& operator=(const StagedMap&) = delete;

  const std::string& name() const { return name_; }  ///< until it is published
  /// Returns the map under its own name.
  MapInfo publish(const std::optional<Staging::Along>& along = {});

 private:
  Store& store_;
  const std::string to_be_;
  std::string name_;
  bool published_ = false;
};

}  // namespace cellmap
