#pragma once

#include <spdlog/logger.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "cellmap/scan/scan_source.hpp"
#include "cellmap/store/store.hpp"
#include "server/api/map_state.hpp"
#include "server/jobs/ingest_request.hpp"
#include "server/jobs/merge.hpp"
#include "server/jobs/upload_source.hpp"
#include "server/metrics.hpp"

namespace cellmap::server {

struct JobQueueOptions {
  /// False: another server over the same store carries out jobs, and this one takes none.
  bool carries_out = true;
  int threads = 1;                                ///< of one job's computations; 0: all
  int workers = 16;                               ///< jobs that run at a time; uploads mostly wait
  std::size_t max_unfinished = 64;                ///< queued and running jobs; more are refused
  std::vector<std::filesystem::path> data_roots;  ///< canonical
  UploadOptions upload;
};

/// A job as it stands.
struct JobView {
  JobRecord record;
  std::string session;
  double scans_per_second = 0;
  std::optional<double> eta_s;
  std::optional<std::uint64_t> next_scan;
  std::size_t room = 0;       ///< scans that an unfinished upload takes without waiting
  bool completed = false;     ///< an unfinished upload of which the client said that it has ended
  std::uint64_t version = 0;  ///< grows with every change while the job is unfinished
};

/// Runs jobs: drives that the server reads and merges one a map at a time, in order; drives that
/// robots send at once, side by side. Jobs survive a restart: what was queued or
/// running is queued again by the constructor and goes on after its last stored CELL. Thread safe.
/// Every method throws Error{kNotFound} for a job or a map that is not there.
class JobQueue {
 public:
  JobQueue(Maps& maps, Metrics& metrics, std::shared_ptr<spdlog::logger> log,
           JobQueueOptions options);
  /// Stops; running jobs are queued again at the next start.
  ~JobQueue();

  /// Queues an ingest. Where an unfinished job reads the same session already: that job if it was
  /// asked the same way, else Error{kConflict}. Error{kUnavailable} where there are too many.
  JobView submit(const std::string& map, const Json& request);
  /// Queues a merge into a map. Error{kNotFound} for a map that is not there, {kInvalidArgument}
  /// for the map itself.
  JobView submit_merge(const std::string& map, const Json& request);
  /// Queues a conversion (`convert_cells`). Error{kConflict} where CELLs are kept within a wider
  /// bound.
  JobView submit_convert(const std::string& map, const Json& request);
  JobView job(JobId id) const;
  std::vector<JobView> jobs(const std::string& map) const;
  /// The session's unfinished job, else its last one since the map was made, else nullopt.
  std::optional<JobView> latest_job(const std::string& map, const std::string& session) const;
  /// Error{kConflict} where the job has ended.
  JobView cancel(JobId id);

  /// Error{kConflict} where the job takes no scans (any more), Error{kUnavailable} where the queue
  /// stops.
  UploadSource::Put put_scan(JobId id, PosedScan scan);
  JobView complete(JobId id);

  /// Returns when the job's version differs from `seen`, the job has ended, the queue stops, or
  /// time is up.
  JobView wait(JobId id, std::uint64_t seen, std::chrono::milliseconds timeout) const;

  bool has_unfinished(const std::string& map) const;
  struct Counts {
    std::size_t queued = 0, running = 0;
  };
  Counts unfinished() const;

  /// Stops taking and running jobs; `wait` returns at once from now on. Blocks until all workers
  /// ended.
  void stop();
  bool is_stopping() const;

 private:
  struct LiveJob;
  using LiveJobs = std::map<JobId, std::shared_ptr<LiveJob>>;

  std::shared_ptr<LiveJob> make_live(JobRecord record, IngestRequest request) const;
  std::shared_ptr<LiveJob> make_live(JobRecord record, MergeRequest request) const;
  std::shared_ptr<LiveJob> make_live(JobRecord record, const CellForm& form) const;
  std::shared_ptr<LiveJob> revive(JobRecord record) const;
  void require_room() const;
  JobView start(std::shared_ptr<LiveJob> job);
  std::shared_ptr<LiveJob> live(JobId id) const;  // null where it has ended
  std::shared_ptr<LiveJob> upload_of(JobId id) const;
  static JobView view(const LiveJob& job);
  static JobView view(const JobRecord& record);
  void recover();
  void work();
  std::shared_ptr<LiveJob> next_runnable() const;
  void run(LiveJob& job);
  void carry_out(LiveJob& job, const IngestHooks& hooks);
  void finish(LiveJob& job, JobState state, const std::string& code, const std::string& message);
  void touch(LiveJob& job);

  Maps& maps_;
  Store& store_;
  Metrics& metrics_;
  std::shared_ptr<spdlog::logger> log_;
  JobQueueOptions options_;
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  LiveJobs live_;  ///< unfinished jobs
  bool stopping_ = false;
  std::mutex submit_mutex_;
  std::vector<std::thread> workers_;
};

}  // namespace cellmap::server
