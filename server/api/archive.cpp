#include <algorithm>
#include <array>
#include <chrono>
#include <list>
#include <mutex>

#include "cellmap/archive/store_archive.hpp"
#include "cellmap/core/error.hpp"
#include "server/api/api.hpp"
#include "server/api/conditions.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"

// /v1/maps/{map}/archive.

namespace cellmap::server {
namespace {

constexpr const char* kArchiveType = "application/vnd.cellmap.archive";
constexpr std::size_t kKeptFiles = 2;
constexpr std::chrono::seconds kPatience{10};

/// Without an encoding every bit of the CELLs that the map has: packed, or compact as it keeps
/// them.
ArchiveOptions read_options(const Services& services, const Call& call) {
  ArchiveOptions options = default_archive_options(services.store.map(call.path("map")));
  if (const auto name = call.query("encoding")) {
    options.encoding = archive_encoding_from_string(*name);
  }
  const auto bound = call.query_number("bound", kMinCompactBoundM, kMaxCompactBoundM);
  if (bound && options.encoding != ArchiveEncoding::kCompact) {
    throw Error(ErrorCode::kInvalidArgument, "'bound' goes with encoding=compact only.");
  }
  if (call.query("encoding")) options.bound_m = kDefaultCompactBoundM;
  options.bound_m = bound.value_or(options.bound_m);
  return options;
}

/// What an archive of the map would say of it now, as far as no CELL has to be looked at.
ArchiveFooter footer_now(const Store& store, const std::string& map) {
  const MapInfo info = store.map(map);
  ArchiveFooter footer;
  footer.created = info.created;
  footer.revision = info.revision;
  footer.georeference = info.georeference;
  for (const SessionInfo& session : store.sessions(map)) {
    footer.sessions.push_back(
        {session.name, session.robot, session.sensor, session.odometry_frame, session.started});
  }
  return footer;
}

/// Of what a footer says: a map's revision alone knows neither sessions' descriptions nor where the
/// map lies on Earth.
std::string etag_of(const ArchiveFooter& footer, const ArchiveOptions& options) {
  std::string text =
      std::to_string(footer.created) + " " + std::string(to_string(options.encoding));
  if (options.encoding == ArchiveEncoding::kCompact) text += std::to_string(options.bound_m);
  for (const ArchiveSession& session : footer.sessions) {
    text += "\n" + session.name + "\n" + session.robot + "\n" + session.sensor + "\n" +
            session.odometry_frame + "\n" + std::to_string(session.started);
  }
  if (const auto& place = footer.georeference) {
    for (const double value : {place->latitude_deg, place->longitude_deg, place->height_m}) {
      text += "\n" + to_hex(sha256(std::as_bytes(std::span(&value, 1))));
    }
    text += to_hex(sha256(std::as_bytes(std::span(place->R_enu_map.data(), 9))));
  }
  const std::string hash = to_hex(sha256(as_bytes(text)));
  return '"' + std::to_string(footer.revision) + "-" + hash.substr(0, 16) + '"';
}

/// The archives made last, in files without names, so that a client can fetch one in parts. One is
/// made at a time: it is work for the processor and the disk. Thread safe.
class ArchiveFiles {
 public:
  struct Entry {
    std::string etag;
    std::shared_ptr<ByteFile> file;
  };

  Entry open(Services& services, const std::string& map, const ArchiveOptions& options) {
    const std::unique_lock lock(mutex_, kPatience);
    if (!lock) {
      throw Error(ErrorCode::kUnavailable, "Another archive is being made; try again.");
    }
    const auto kept =
        std::ranges::find(kept_, etag_of(footer_now(services.store, map), options), &Entry::etag);
    if (kept != kept_.end()) {
      kept_.splice(kept_.begin(), kept_, kept);
      return kept_.front();
    }
    std::shared_ptr<ByteFile> file = open_temporary_file(services.options.spool_folder);
    archive_map(services.store, map, *file, options);
    // What came to the map meanwhile may be in the archive.
    const Entry entry{etag_of(ArchiveReader(borrowed(*file)).footer(), options), file};
    kept_.push_front(entry);
    if (kept_.size() > kKeptFiles) kept_.pop_back();
    return entry;
  }

 private:
  std::timed_mutex mutex_;
  std::list<Entry> kept_;  ///< most recent first
};

Response get_archive(Services& services, ArchiveFiles& files, const Call& call) {
  const auto& map = call.path("map");
  const ArchiveOptions options = read_options(services, call);
  const std::string now = etag_of(footer_now(services.store, map), options);
  const auto is_named = [](std::string_view condition, const std::string& etag) {
    return matches_etag(condition, std::array{etag});
  };
  Response response;
  response.headers.set("ETag", now);
  response.headers.set("Accept-Ranges", "bytes");
  const auto if_none_match = call.header("If-None-Match");
  if (if_none_match && is_named(*if_none_match, now)) {
    response.status = 304;
    return response;
  }
  const auto if_match = call.header("If-Match");
  if (if_match && !is_named(*if_match, now)) {
    throw Error(ErrorCode::kPreconditionFailed, "The map has changed; begin anew.");
  }
  const auto [etag, file] = files.open(services, map, options);
  if (if_match && !is_named(*if_match, etag)) {
    throw Error(ErrorCode::kPreconditionFailed, "The map has changed; begin anew.");
  }
  response.headers.set("ETag", etag);
  response.headers.set("Content-Type", kArchiveType);
  response.headers.set("Content-Disposition", "attachment; filename=\"" + map + ".cellmap\"");
  const std::uint64_t size = file->size();
  const auto part = answer_range(call.header("Range"), size, response);
  if (!part) return range_not_satisfiable(size);
  response.body = FileBody{file, part->offset, part->length};
  return response;
}

Response put_archive(Services& services, const Call& call) {
  const auto& map = call.path("map");
  validate_map_name(map);
  call.content_type({kArchiveType});
  const auto file = call.file();
  ArchiveReader archive(borrowed(*file));
  const MapInfo restored = restore_map(archive, services.store, map);
  services.metrics.cells_committed(restored.cells);
  Response response = json_response(to_json(restored), 201);
  response.headers.set("Location", "/v1/maps/" + map);
  return response;
}

}  // namespace

void add_archive_routes(Router& router, Services& services) {
  const auto files = std::make_shared<ArchiveFiles>();
  const std::string path = "/v1/maps/{map}/archive";
  router.add({"GET",
              path,
              {"encoding", "bound"},
              0,
              {kArchiveType},
              [&, files](const Call& call) { return get_archive(services, *files, call); },
              true});
  router.add({"PUT",
              path,
              {},
              services.options.max_archive_bytes,
              {"application/json"},
              [&](const Call& call) { return put_archive(services, call); },
              true,
              true});
}

}  // namespace cellmap::server
