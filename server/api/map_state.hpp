#pragma once

#include <atomic>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "cellmap/pipeline/back_end.hpp"
#include "cellmap/place/loop_detection.hpp"
#include "cellmap/place/place_search.hpp"
#include "cellmap/place/relocalise.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "cellmap/store/store.hpp"
#include "server/api/place_parts.hpp"

namespace cellmap::server {

/// Decodes a stored CELL. Throws as the store and the codec do.
Cell load_cell(const Store& store, const std::string& map, CellId id);

/// The CELLs most recently registered to, shared by all maps. Thread safe; about 0.5 MB a target.
class TargetCache {
 public:
  explicit TargetCache(std::size_t capacity) : capacity_(capacity) {}

  /// `map_key` tells apart maps, also one that was deleted from its successor of the same name.
  std::shared_ptr<const RegistrationTarget> find(std::uint64_t map_key, CellId id);
  void insert(std::uint64_t map_key, CellId id, std::shared_ptr<const RegistrationTarget> target);
  void erase(std::uint64_t map_key, CellId id);

 private:
  using Key = std::pair<std::uint64_t, CellId>;
  using Entry = std::pair<Key, std::shared_ptr<const RegistrationTarget>>;
  std::mutex mutex_;
  std::size_t capacity_;
  std::list<Entry> entries_;  ///< most recent first
  std::map<Key, std::list<Entry>::iterator> by_key_;
};

/// What the server holds of one map in memory: a copy of what the store knows, loaded when it is
/// first needed. Readers get immutable values; a writer never waits for them nor they for it.
/// Thread safe.
class MapState {
 public:
  MapState(Store& store, TargetCache& cache, PartCache& parts, const OnUnkept& on_unkept,
           std::shared_ptr<const Lattice> lattice, const MapInfo& info, std::uint64_t key);

  const std::string& name() const { return name_; }
  Stamp created() const { return created_; }
  const std::shared_ptr<const Lattice>& lattice() const { return lattice_; }

  /// The pose graph of the store's current revision.
  std::shared_ptr<const PoseGraph> graph() const;
  /// Saves reading again what was just committed: the graph of that revision.
  void publish(PoseGraph graph) const;

  /// With the planes that the CELL has in the last `graph`, or later ones.
  std::shared_ptr<const RegistrationTarget> target(CellId id) const;
  /// Keeps the state alive.
  static TargetProvider targets(std::shared_ptr<const MapState> state);
  static MapAccess access(const std::shared_ptr<const MapState>& state);

  /// An index of the CELLs of `graph`, whose descriptors are made when a query needs them.
  std::shared_ptr<const PlaceIndex> place_index(const PoseGraph& graph) const;

  /// What can be relocalised in: the CELLs that are in the map frame, at one revision.
  struct Places {
    std::shared_ptr<const PoseGraph> graph;
    std::shared_ptr<const PlaceRegions> regions;    ///< of it
    std::shared_ptr<const PlaceSearcher> searcher;  ///< of them, in this process
  };
  /// Of the store's current revision.
  Places places() const;

  /// Serialises what changes the map: held from reading the graph that a change starts from until
  /// the change is committed.
  std::mutex& writer() const { return writer_; }

 private:
  /// What was made of CELLs that have had other bytes since, by a conversion here or through
  /// another server.
  void forget_converted(const PoseGraph& now) const;
  std::set<CellId> cells_changed_by(const PoseGraph& now) const;
  std::shared_ptr<DescribedCells> described_cells() const;

  Store& store_;
  TargetCache& cache_;
  PartCache& parts_;
  const OnUnkept& on_unkept_;
  std::shared_ptr<const Lattice> lattice_;
  std::string name_;
  Stamp created_;
  std::uint64_t key_;
  mutable std::mutex writer_;
  mutable std::mutex contents_mutex_;
  mutable std::atomic<Revision>
      contents_;  ///< what is kept of CELLs is of their bytes then, or later
  mutable std::mutex graph_mutex_;
  mutable std::shared_ptr<const PoseGraph> graph_;
  mutable std::mutex places_mutex_;
  mutable std::shared_ptr<DescribedCells> described_;
  mutable Places places_;  ///< of the revision that was last asked for
};

struct MapsOptions {
  std::size_t loaded_maps = 16;                    ///< states kept; more only while they are in use
  std::size_t cached_targets = 256;                ///< RegistrationTargets, about 0.5 MB each
  std::size_t place_bytes = std::size_t{4} << 30;  ///< of descriptors of CELLs, of all maps
  OnUnkept on_unkept;                              ///< may be empty; thread safe
};

/// The states of the maps of a store. Thread safe.
class Maps {
 public:
  explicit Maps(Store& store, const MapsOptions& options = {});

  /// Throws Error{kNotFound}.
  std::shared_ptr<const MapState> open(const std::string& name);
  void forget(const std::string& name);
  Store& store() { return store_; }
  std::size_t place_bytes() const { return parts_.bytes(); }  ///< of descriptors in memory

 private:
  Store& store_;
  MapsOptions options_;
  LatticeCache lattices_;
  TargetCache cache_;
  PartCache parts_;
  std::mutex mutex_;
  std::uint64_t next_key_ = 1;
  std::list<std::shared_ptr<const MapState>> states_;  ///< most recent first
};

}  // namespace cellmap::server
