#include "server/jobs/merge.hpp"

#include <algorithm>
#include <span>
#include <utility>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/core/hash.hpp"
#include "cellmap/pose_graph/frames.hpp"
#include "cellmap/store/copy_sessions.hpp"
#include "cellmap/store/documents.hpp"
#include "server/jobs/redo.hpp"

namespace cellmap::server {
namespace {

constexpr std::size_t kMaxSessions = 1000;

/// The same for the same sessions of the same map only: a map by a name that was used before, or
/// other sessions, are another merge.
std::string note_name(const Store& store, const std::string& from,
                      const std::set<std::string>& sessions) {
  std::string text = from + "\n" + std::to_string(store.version(from).created);
  for (const std::string& session : sessions) text += "\n" + session;
  return "merge-" + to_hex(sha256(std::as_bytes(std::span(text)))).substr(0, 32);
}

/// The second half of a merge: every copied CELL is looked for in the rest of the map, and again,
/// where its island joined later. How far it is stands in a document beside the map, so that a
/// server that was killed goes on where it was: looking twice would find other loops than looking
/// once, because poses have moved meanwhile.
class MergeVisits {
 public:
  MergeVisits(Store& store, const MapState& state, BackEnd back_end, std::string note,
              std::set<CellId> copied)
      : store_(store),
        state_(state),
        back_end_(std::move(back_end)),
        document_(std::move(note)),
        copied_(std::move(copied)) {
    read();
  }

  void run(const std::stop_token& stop) {
    const std::vector<CellId> all(copied_.begin(), copied_.end());
    while (done_ < all.size()) visit(stop, all[done_], true);
    while (done_ < all.size() + early_.size()) visit(stop, early_[done_ - all.size()], false);
    documents_of(store_).remove_document(state_.name(), document_);
  }

 private:
  void visit(const std::stop_token& stop, CellId id, bool first_time) {
    throw_if_stopped(stop);
    const std::lock_guard lock(state_.writer());
    PoseGraph graph = *state_.graph();
    const bool skipped = !first_time && graph.unaligned.contains(id);
    if (!skipped && !was_committed()) {
      redo_until_current(stop, [&] {
        graph = *state_.graph();
        const Revision seen = graph.revision;
        CellUpdate found = back_end_.revisit(id, finished_without_scans(state_.target(id)), graph);
        if (found.constraints.empty()) return;
        MapUpdate update = to_map_update(std::move(found));
        update.expected_revision = seen;
        store_.commit(state_.name(), update);
      });
    }
    if (first_time && graph.unaligned.contains(id)) early_.push_back(id);
    ++done_;
    write();
  }

  /// True where this visit changed the map and the server ended before it could note that: what
  /// ties a copied CELL is new since the last note.
  bool was_committed() {
    if (!std::exchange(is_resumed_, false)) return false;
    const MapChanges changes = store_.changes(state_.name(), noted_at_);
    return std::ranges::any_of(changes.added_constraints, [&](const Constraint& constraint) {
      return copied_.contains(constraint.from) || copied_.contains(constraint.to);
    });
  }

  void write() {
    Json early = Json::array();
    for (const CellId id : early_) early.push_back(id.value);
    const Json note{{"done", done_},
                    {"early", std::move(early)},
                    {"revision", store_.version(state_.name()).revision}};
    documents_of(store_).put_document(state_.name(), document_, dump(note));
  }

  void read() {
    const auto text = documents_of(store_).document(state_.name(), document_);
    if (!text) return write();
    const Json note = parse_json(*text);
    done_ = note.at("done").get<std::size_t>();
    for (const Json& id : note.at("early")) early_.push_back({id.get<std::uint32_t>()});
    noted_at_ = note.at("revision").get<Revision>();
    is_resumed_ = true;
  }

  Store& store_;
  const MapState& state_;
  const BackEnd back_end_;
  const std::string document_;
  const std::set<CellId> copied_;
  std::size_t done_ = 0;       ///< visits, of all copied CELLs and then of the early ones
  std::vector<CellId> early_;  ///< seen before their island joined
  Revision noted_at_ = 0;
  bool is_resumed_ = false;
};

}  // namespace

MergeRequest parse_merge_request(const Json& json) {
  MergeRequest request;
  ObjectReader reader(json, "the merge");
  const auto from = reader.text("from");
  if (!from) throw Error(ErrorCode::kInvalidArgument, "Expected 'from', the name of a map.");
  request.from = *from;
  validate_map_name(request.from);
  if (const Json* sessions = reader.array("sessions", kMaxSessions)) {
    request.sessions = session_names(*sessions);
  }
  reader.finish();
  return request;
}

void run_merge(Maps& maps, Store& store, const std::string& map, const MergeRequest& request,
               const std::stop_token& stop, const IngestHooks& hooks) {
  std::set<std::string> sessions = request.sessions;
  if (sessions.empty()) {
    for (const SessionInfo& session : store.sessions(request.from)) sessions.insert(session.name);
  }
  const auto state = maps.open(map);
  std::map<CellId, CellId> copied;
  {
    const std::lock_guard lock(state->writer());
    copied = redo_until_current(stop, [&] {
      return copy_sessions(store, request.from, sessions, map, stop, hooks.committed);
    });
  }
  std::set<CellId> ids;
  for (const auto& [old, id] : copied) ids.insert(id);
  MergeVisits visits(store, *state, BackEnd(request.options, MapState::access(state)),
                     note_name(store, request.from, sessions), std::move(ids));
  visits.run(stop);
}

}  // namespace cellmap::server
