#include "server/api/map_state.hpp"

#include <algorithm>

#include "cellmap/store/read_cell.hpp"

namespace cellmap::server {
namespace {

/// The graph without what is not in the map frame yet, where nobody can be.
std::shared_ptr<const PoseGraph> aligned(std::shared_ptr<const PoseGraph> graph) {
  if (graph->unaligned.empty()) return graph;
  PoseGraph rest;
  rest.revision = graph->revision;
  for (const auto& [id, pose] : graph->nodes) {
    if (!graph->unaligned.contains(id)) rest.nodes.emplace_hint(rest.nodes.end(), id, pose);
  }
  return std::make_shared<const PoseGraph>(std::move(rest));
}

MapState::Places places_of(std::shared_ptr<DescribedCells> described,
                           std::shared_ptr<const PoseGraph> graph) {
  auto regions = std::make_shared<const PlaceRegions>(*graph);
  auto parts = std::make_shared<const PartsOfGraph>(std::move(described), regions);
  return {std::move(graph), std::move(regions),
          std::make_shared<const PartsSearcher>(std::move(parts))};
}

}  // namespace

Cell load_cell(const Store& store, const std::string& map, CellId id) {
  return read_cell(store, map, id);
}

std::shared_ptr<const RegistrationTarget> TargetCache::find(std::uint64_t map_key, CellId id) {
  const std::lock_guard lock(mutex_);
  const auto found = by_key_.find({map_key, id});
  if (found == by_key_.end()) return nullptr;
  entries_.splice(entries_.begin(), entries_, found->second);
  return found->second->second;
}

void TargetCache::insert(std::uint64_t map_key, CellId id,
                         std::shared_ptr<const RegistrationTarget> target) {
  const std::lock_guard lock(mutex_);
  const Key key{map_key, id};
  if (by_key_.contains(key)) return;
  entries_.emplace_front(key, std::move(target));
  by_key_[key] = entries_.begin();
  if (entries_.size() <= capacity_) return;
  by_key_.erase(entries_.back().first);
  entries_.pop_back();
}

void TargetCache::erase(std::uint64_t map_key, CellId id) {
  const std::lock_guard lock(mutex_);
  const auto found = by_key_.find({map_key, id});
  if (found == by_key_.end()) return;
  entries_.erase(found->second);
  by_key_.erase(found);
}

MapState::MapState(Store& store, TargetCache& cache, PartCache& parts, const OnUnkept& on_unkept,
                   std::shared_ptr<const Lattice> lattice, const MapInfo& info, std::uint64_t key)
    : store_(store),
      cache_(cache),
      parts_(parts),
      on_unkept_(on_unkept),
      lattice_(std::move(lattice)),
      name_(info.name),
      created_(info.created),
      key_(key),
      contents_(info.revision) {}

std::shared_ptr<const PoseGraph> MapState::graph() const {
  const Revision revision = store_.map(name_).revision;
  {
    const std::lock_guard lock(graph_mutex_);
    if (graph_ && graph_->revision == revision) return graph_;
  }
  auto loaded = std::make_shared<const PoseGraph>(store_.pose_graph(name_));
  forget_converted(*loaded);
  const std::lock_guard lock(graph_mutex_);
  if (!graph_ || graph_->revision < loaded->revision) graph_ = loaded;
  return loaded;
}

void MapState::publish(PoseGraph graph) const {
  // What is published converts nothing; what came before it from elsewhere may have.
  Revision before = graph.revision - 1;
  if (!contents_.compare_exchange_strong(before, graph.revision)) forget_converted(graph);
  auto published = std::make_shared<const PoseGraph>(std::move(graph));
  const std::lock_guard lock(graph_mutex_);
  if (!graph_ || graph_->revision < published->revision) graph_ = std::move(published);
}

std::shared_ptr<const RegistrationTarget> MapState::target(CellId id) const {
  if (auto cached = cache_.find(key_, id)) return cached;
  const Revision before = contents_;
  auto cell = std::make_shared<const Cell>(load_cell(store_, name_, id));
  auto target = std::make_shared<const RegistrationTarget>(std::move(cell), lattice_);
  if (contents_ == before) cache_.insert(key_, id, target);
  return target;
}

/// Since `contents_` was: those that came or were converted, or all where nobody can tell.
std::set<CellId> MapState::cells_changed_by(const PoseGraph& now) const {
  std::set<CellId> changed;
  try {
    for (const CellRecord& cell : store_.changes(name_, contents_).added) changed.insert(cell.id);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kNotFound) throw;  // a session was removed since
    for (const auto& [id, pose] : now.nodes) changed.insert(id);
  }
  return changed;
}

void MapState::forget_converted(const PoseGraph& now) const {
  const std::lock_guard lock(contents_mutex_);
  if (now.revision <= contents_) return;
  std::shared_ptr<const PoseGraph> known;
  {
    const std::lock_guard graph_lock(graph_mutex_);
    known = graph_;
  }
  bool was_described = false;
  for (const CellId id : cells_changed_by(now)) {
    cache_.erase(key_, id);
    was_described = was_described || (known && known->nodes.contains(id));
  }
  if (was_described) {
    const std::lock_guard places_lock(places_mutex_);
    described_.reset();
    places_ = {};
  }
  contents_ = now.revision;
}

TargetProvider MapState::targets(std::shared_ptr<const MapState> state) {
  return [state = std::move(state)](CellId id) { return state->target(id); };
}

MapAccess MapState::access(const std::shared_ptr<const MapState>& state) {
  return {targets(state), [state](const PoseGraph& graph) { return state->place_index(graph); }};
}

std::shared_ptr<DescribedCells> MapState::described_cells() const {
  const std::lock_guard lock(places_mutex_);
  if (!described_) {
    described_ = std::make_shared<DescribedCells>(store_, parts_, name_, lattice_, on_unkept_);
  }
  return described_;
}

std::shared_ptr<const PlaceIndex> MapState::place_index(const PoseGraph& graph) const {
  // The regions have copies of what they need of it.
  const Places places = places_of(described_cells(), {std::shared_ptr<void>(), &graph});
  return std::make_shared<const PlaceIndex>(places.regions, places.searcher);
}

MapState::Places MapState::places() const {
  const auto current = graph();
  {
    const std::lock_guard lock(places_mutex_);
    if (places_.graph && places_.graph->revision == current->revision) return places_;
  }
  const auto described = described_cells();
  const Places places = places_of(described, aligned(current));
  const std::lock_guard lock(places_mutex_);
  const bool is_newer = !places_.graph || places_.graph->revision < current->revision;
  if (is_newer && described == described_) places_ = places;
  return places;
}

Maps::Maps(Store& store, const MapsOptions& options)
    : store_(store),
      options_(options),
      cache_(options.cached_targets),
      parts_(options.place_bytes) {}

std::shared_ptr<const MapState> Maps::open(const std::string& name) {
  const MapInfo info = store_.map(name);
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find(states_, name, [](const auto& s) { return s->name(); });
  if (found != states_.end()) {
    if ((*found)->created() == info.created && (*found)->lattice()->spec() == info.lattice) {
      states_.splice(states_.begin(), states_, found);
      return states_.front();
    }
    states_.erase(found);  // another map by the same name
  }
  states_.push_front(std::make_shared<const MapState>(
      store_, cache_, parts_, options_.on_unkept, lattices_.get(info.lattice), info, next_key_++));
  auto opened = states_.front();
  for (auto state = std::prev(states_.end());
       states_.size() > options_.loaded_maps && state != states_.begin();) {
    const auto candidate = state--;
    if (candidate->use_count() == 1) states_.erase(candidate);
  }
  return opened;
}

void Maps::forget(const std::string& name) {
  const std::lock_guard lock(mutex_);
  std::erase_if(states_, [&](const auto& state) { return state->name() == name; });
}

}  // namespace cellmap::server
