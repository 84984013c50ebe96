#include "cellmap/store/copy_sessions.hpp"

#include <algorithm>

#include "cellmap/core/error.hpp"
#include "cellmap/store/all_cells.hpp"
#include "cellmap/store/read_cell.hpp"

namespace cellmap {
namespace {

/// Whether a map has CELLs of other sessions: of these, a copy that broke off may have left some.
bool has_others(const Store& store, const std::string& map, const std::set<std::string>& sessions) {
  return std::ranges::any_of(store.sessions(map), [&](const SessionInfo& session) {
    return session.cells > 0 && !sessions.contains(session.name);
  });
}

/// One copy: what it knows of both maps.
class SessionCopy {
 public:
  SessionCopy(Store& store, const std::string& from, const std::set<std::string>& sessions,
              const std::string& to)
      : store_(store),
        from_(from),
        to_(to),
        source_(store.pose_graph(from)),
        joins_others_(has_others(store, to, sessions)) {
    const PoseGraph target = store.pose_graph(to);
    next_ = target.new_cell_id();
    revision_ = target.revision;
    if (store.map(from).lattice != store.map(to).lattice) {
      throw Error(ErrorCode::kInvalidArgument, "maps " + from + " and " + to +
                                                   " have different lattices; their CELLs cannot "
                                                   "be compared");
    }
  }

  /// The CELLs of a session that are still to be copied, in order.
  std::vector<CellRecord> missing(const SessionInfo& session) {
    const auto there = all_cells_of(store_, to_, session.name);
    auto wanted = all_cells_of(store_, from_, session.name);
    for (std::size_t i = 0; i < there.size(); ++i) {
      if (i >= wanted.size() || there[i].hash != wanted[i].hash) {
        throw Error(ErrorCode::kConflict, "map " + to_ + " has a session '" + session.name +
                                              "' of its own; a session's name is part of its "
                                              "CELLs, so map the drive anew under another name");
      }
      ids_[wanted[i].id] = there[i].id;
    }
    wanted.erase(wanted.begin(), wanted.begin() + static_cast<std::ptrdiff_t>(there.size()));
    return wanted;
  }

  void add(const CellRecord& record, const CellScans* stretch) {
    NewCell cell;
    cell.id = next_;
    KeptCell kept = read_kept_cell(store_, from_, record.id);
    cell.cell = std::move(kept.cell);
    cell.encoded = std::move(kept.encoded);
    cell.coded = std::move(kept.coded);
    cell.T_map_cell = source_.nodes.at(record.id);
    cell.unaligned = joins_others_ || source_.unaligned.contains(record.id);
    if (stretch) {
      cell.scans = stretch->scans;
      cell.raw_points = stretch->raw_points;
      cell.voxel_points = stretch->voxel_points;
    }
    MapUpdate update;
    update.cells.push_back(std::move(cell));
    commit(update);
    ids_[record.id] = next_;
    ++next_.value;
  }

  std::map<CellId, CellId> finish() {
    MapUpdate update;
    for (Constraint constraint : source_.constraints) {
      const auto a = ids_.find(constraint.from), b = ids_.find(constraint.to);
      if (a == ids_.end() || b == ids_.end()) continue;
      constraint.from = a->second;
      constraint.to = b->second;
      constraint.id = {};
      update.add_constraints.push_back(std::move(constraint));
    }
    commit(update);
    return std::move(ids_);
  }

 private:
  void commit(MapUpdate& update) {
    update.expected_revision = revision_;
    revision_ = store_.commit(to_, update).revision;
  }

  Store& store_;
  const std::string &from_, &to_;
  const PoseGraph source_;
  const bool joins_others_;
  CellId next_;
  Revision revision_ = 0;  ///< of the target; ids of CELLs to come depend on it
  std::map<CellId, CellId> ids_;
};

}  // namespace

std::map<CellId, CellId> copy_sessions(Store& store, const std::string& from,
                                       const std::set<std::string>& sessions, const std::string& to,
                                       const std::stop_token& stop,
                                       const ProgressCallback& progress) {
  SessionCopy copy(store, from, sessions, to);
  std::vector<std::pair<SessionInfo, std::vector<CellRecord>>> work;  // refused before it begins
  std::set<std::string> absent = sessions;
  for (const SessionInfo& session : store.sessions(from)) {
    if (absent.erase(session.name) > 0) work.emplace_back(session, copy.missing(session));
  }
  if (!absent.empty()) {
    throw Error(ErrorCode::kNotFound, "map " + from + " has no session '" + *absent.begin() + "'");
  }
  Progress done;
  for (const auto& [session, cells] : work) {
    store.create_session(to, session);
    std::map<CellId, CellScans> stretches;
    for (CellScans& stretch : store.scans(from, session.name)) {
      stretches.emplace(stretch.cell, std::move(stretch));
    }
    for (const CellRecord& cell : cells) {
      throw_if_stopped(stop);
      const auto stretch = stretches.find(cell.id);
      copy.add(cell, stretch == stretches.end() ? nullptr : &stretch->second);
      ++done.cells_done;
      if (progress) progress(done);
    }
  }
  return copy.finish();
}

}  // namespace cellmap
