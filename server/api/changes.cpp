#include <algorithm>
#include <thread>

#include "cellmap/codec/changes_codec.hpp"
#include "cellmap/core/error.hpp"
#include "server/api/api.hpp"
#include "server/api/compress.hpp"
#include "server/api/conditions.hpp"
#include "server/api/follower.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"

// /v1/maps/{map}/changes, at once or when there are any, and /v1/maps/{map}/events.

namespace cellmap::server {
namespace {

using Clock = std::chrono::steady_clock;

constexpr const char* kChangesType = "application/vnd.cellmap.changes";
constexpr double kMaxWait_s = 60;

/// Which version a map has: as soon as it is not `known`, the server stops, or at the deadline.
/// Looks only when something was committed. Throws Error{kNotFound} when the map is deleted.
MapVersion wait_for_other(const Services& services, const std::string& map, const MapVersion& known,
                          Clock::time_point deadline) {
  CommitSignal& committed = services.store.committed();
  for (;;) {
    const auto seen = committed.count();
    const MapVersion found = services.store.version(map);
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now());
    if (found != known || services.stopping || left.count() <= 0) return found;
    committed.wait(seen, left);
  }
}

Json changes_to_json(const MapChanges& changes) {
  Json added = Json::array(), constraints = Json::array();
  Json removed = Json::array(), removed_constraints = Json::array(), judged = Json::array();
  for (const auto& cell : changes.added) added.push_back(to_json(cell));
  for (const auto& constraint : changes.added_constraints) {
    constraints.push_back(to_json(constraint));
  }
  for (const auto id : changes.removed) removed.push_back(id.value);
  for (const auto id : changes.removed_constraints) removed_constraints.push_back(id.value);
  for (const auto& [id, judgement] : changes.judged) {
    judged.push_back(
        {{"id", id.value}, {"weight", judgement.weight}, {"pinned", judgement.pinned}});
  }
  return {{"since", changes.since},
          {"revision", changes.revision},
          {"added", std::move(added)},
          {"moved", nodes_to_json(changes.moved)},
          {"removed", std::move(removed)},
          {"unaligned", ids_to_json(changes.unaligned)},
          {"added_constraints", std::move(constraints)},
          {"removed_constraints", std::move(removed_constraints)},
          {"judged", std::move(judged)}};
}

/// Holds the request back while the map has no other revision than the one that the client has.
void wait_for_news(Services& services, const std::string& map, Revision since, double wait_s) {
  const MapVersion known = services.store.version(map);
  if (wait_s <= 0 || known.revision != since) return;
  const Follower follower(services);
  const auto wait =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(wait_s));
  wait_for_other(services, map, known, Clock::now() + wait);
}

Response changes(Services& services, const Call& call) {
  constexpr std::array<std::string_view, 2> types{"application/json", kChangesType};
  const auto type = negotiate(call.header("Accept"), types);
  if (!type) return not_acceptable(types);
  const auto& map = call.path("map");
  const Revision since = call.query_integer("since", 0, INT64_MAX).value_or(0);
  wait_for_news(services, map, since, call.query_number("wait_s", 0, kMaxWait_s).value_or(0));
  const MapChanges changes = services.store.changes(map, since);
  Response response;
  response.headers.set("Content-Type", *type);
  response.headers.set("Cache-Control", "no-store");
  response.headers.set("Vary", "Accept");
  // Read after the changes: a map that was made anew meanwhile is never taken for the old one.
  response.headers.set("CELLmap-Created", to_rfc3339(services.store.version(map).created));
  if (*type == kChangesType) {
    const auto bytes = std::make_shared<const Bytes>(encode_changes(changes));
    response.body = SharedBytes{bytes, 0, bytes->size()};
  } else {
    response.body = dump(changes_to_json(changes));
  }
  compress_if_accepted(call, response);
  return response;
}

/// The stream of one follower of a map: its state between two pieces.
class RevisionEvents {
 public:
  /// `last`: the revision that the client has, as Last-Event-ID says.
  RevisionEvents(Services& services, std::string map, std::optional<Revision> last)
      : services_(services), follower_(services), map_(std::move(map)) {
    seen_ = services_.store.version(map_);
    tell_first_ = last != seen_.revision;
  }

  bool next(std::string& chunk) {
    if (tell_first_) {
      tell_first_ = false;
      tell(chunk);
      return true;
    }
    std::this_thread::sleep_until(last_told_ + kShortestEventInterval);
    MapVersion found;
    try {
      found = wait_for_other(services_, map_, seen_, Clock::now() + services_.options.heartbeat);
    } catch (const Error& error) {
      if (error.code() != ErrorCode::kNotFound) throw;
      return end(chunk, "deleted");
    }
    if (found.created != seen_.created) return end(chunk, "deleted");
    if (services_.stopping) return end(chunk, "stopping");
    if (found == seen_) {
      chunk += ": still here\n\n";
      return true;
    }
    seen_ = found;
    tell(chunk);
    return true;
  }

 private:
  void tell(std::string& chunk) {
    last_told_ = Clock::now();
    chunk +=
        "event: revision\nid: " + std::to_string(seen_.revision) + "\ndata: " +
        dump(
            {{"map", map_}, {"revision", seen_.revision}, {"created", to_rfc3339(seen_.created)}}) +
        "\n\n";
  }
  bool end(std::string& chunk, const char* reason) const {
    chunk += "event: end\ndata: " + dump({{"map", map_}, {"reason", reason}}) + "\n\n";
    return false;
  }

  Services& services_;
  Follower follower_;
  std::string map_;
  MapVersion seen_;
  bool tell_first_ = false;
  Clock::time_point last_told_{};
};

std::optional<Revision> last_event_id(const Call& call) {
  const auto header = call.header("Last-Event-ID");
  if (!header || header->empty()) return std::nullopt;
  const auto revision = parse_unsigned(*header);
  if (!revision) {
    throw Error(ErrorCode::kInvalidArgument,
                "Expected Last-Event-ID to be a revision, found " + in_quotes(*header) + ".");
  }
  return *revision;
}

Response changes_events(Services& services, const Call& call) {
  const auto last = last_event_id(call);
  Response response;
  response.headers.set("Content-Type", "text/event-stream");
  response.headers.set("Cache-Control", "no-store");
  if (call.method() == "HEAD") {
    services.store.version(call.path("map"));
    return response;
  }
  auto events = std::make_shared<RevisionEvents>(services, call.path("map"), last);
  response.body = [events](std::string& chunk) { return events->next(chunk); };
  return response;
}

}  // namespace

void add_change_routes(Router& router, Services& services) {
  const std::string map = "/v1/maps/{map}";
  router.add({"GET",
              map + "/changes",
              {"since", "wait_s"},
              0,
              {},
              [&](const Call& call) { return changes(services, call); },
              true});
  router.add({"GET",
              map + "/events",
              {},
              0,
              {"text/event-stream"},
              [&](const Call& call) { return changes_events(services, call); },
              true});
}

}  // namespace cellmap::server
