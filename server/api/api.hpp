#pragma once

#include <spdlog/logger.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>

#include "server/api/message.hpp"
#include "server/api/place_servers.hpp"
#include "server/api/router.hpp"
#include "server/api/standard_headers.hpp"
#include "server/api/turn.hpp"
#include "server/audit_log.hpp"
#include "server/auth/guard.hpp"
#include "server/jobs/job_queue.hpp"
#include "server/metrics.hpp"

namespace cellmap::server {

struct ApiOptions {
  std::string openapi;           ///< text of schema/openapi.yaml
  std::filesystem::path viewer;  ///< folder of the built viewer; empty: none
  int threads = 0;               ///< of one relocalisation or optimisation; 0: all
  int relocalisations = 2;       ///< that run at a time; others wait up to `relocalisation_wait`
  std::chrono::milliseconds relocalisation_wait = std::chrono::seconds(10);
  /// The same of searches for other servers. Apart from relocalisations, which wait for searches of
  /// other servers: those wait for nobody, so that no circle of servers waits for itself.
  int place_searches = 2;
  PlaceServersOptions place_servers;
  int max_followers = 64;  ///< clients that follow jobs or maps at a time
  std::chrono::milliseconds heartbeat = std::chrono::seconds(5);
  MapsOptions maps;
  JobQueueOptions jobs;
  std::size_t max_archive_bytes = 16ull << 30;  ///< of an uploaded archive
  std::filesystem::path spool_folder;           ///< of large bodies; empty: the system's
  std::filesystem::path store_file;             ///< whose size metrics say; empty: unknown
  auth::Guard* guard = nullptr;            ///< outlives the API; null: everyone may do everything
  AuditLog* audit = nullptr;               ///< outlives the API; null: none
  std::vector<std::string> allow_origins;  ///< as `CrossOrigin` has them
};

/// What handlers work with.
struct Services {
  Services(Store& store, std::shared_ptr<spdlog::logger> log, ApiOptions options);

  ApiOptions options;
  std::shared_ptr<spdlog::logger> log;
  Store& store;
  Metrics metrics;
  Maps maps;
  JobQueue jobs;
  PlaceServers place_servers;
  Turns turns;        ///< of relocalisations and comparisons
  Turns place_turns;  ///< of searches for other servers
  Seldom says_strange_regions;
  std::atomic<int> followers = 0;
  std::atomic<bool> stopping = false;  ///< streams and long polls end
};

/// The HTTP API as a function from request to response; schema/openapi.yaml describes it. Knows no
/// socket. `handle` is thread safe and never throws; it blocks as long as the work takes.
/// The store must outlive the API.
class Api {
 public:
  explicit Api(Store& store, ApiOptions options = {}, std::shared_ptr<spdlog::logger> log = {});
  ~Api();

  Response handle(const Request& request);

  /// Before a body is read: the answer to a request that may not go on, else nullopt, and the
  /// caller is noted in the request, which is not asked again.
  std::optional<Response> refuse(Request& request);

  /// What every answer has, for answers that the front makes itself.
  void complete(Response& response, std::string_view target, const std::string& request_id) const;

  /// How many bytes of body a request may bring: known from its first line, before it is read.
  std::size_t max_body(std::string_view method, std::string_view target) const;
  /// Where its body is to be put, if not into memory; null: into memory.
  std::unique_ptr<ByteFile> file_for_body(std::string_view method, std::string_view target) const;

  /// Whether a request may wait for a job, a follower's next event, its turn or its reader.
  bool may_wait(std::string_view method, std::string_view target) const;

  /// Reads the guard's tokens again; a file that cannot be read is logged and changes nothing.
  void reload_tokens();

  /// Ends jobs (they go on at the next start) and event streams. Requests are still answered.
  void stop();

  const Router& router() const { return router_; }

 private:
  struct Exchange;
  std::optional<Response> admit(const Request& request, Exchange& exchange) const;
  Response answer(const Request& request, Exchange& exchange) const;
  template <class Answer>
  Response caught(const Request& request, const Exchange& exchange, const Answer& answer) const;
  void finish(const Request& request, const Exchange& exchange, Response& response) const;
  void audit(const Request& request, const Exchange& exchange, const Response& response) const;

  std::unique_ptr<Services> services_;
  CrossOrigin cross_origin_;
  Router router_;
};

// One file a resource.
void add_viewer_routes(Router& router, Services& services);
void add_service_routes(Router& router, Services& services);
void add_map_routes(Router& router, Services& services);
void add_cell_routes(Router& router, Services& services);
void add_cell_batch_route(Router& router, Services& services);
void add_pose_graph_routes(Router& router, Services& services);
void add_change_routes(Router& router, Services& services);
void add_relocalise_route(Router& router, Services& services);
void add_place_search_route(Router& router, Services& services);
void add_loop_routes(Router& router, Services& services);
void add_session_routes(Router& router, Services& services);
void add_session_scan_routes(Router& router, Services& services);
void add_split_route(Router& router, Services& services);
void add_georeference_routes(Router& router, Services& services);
void add_archive_routes(Router& router, Services& services);
void add_job_routes(Router& router, Services& services);

}  // namespace cellmap::server
