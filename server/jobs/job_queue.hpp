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
#include "cellmap/store/claims.hpp"
#include "cellmap/store/store.hpp"
#include "server/api/map_state.hpp"
#include "server/jobs/ingest_request.hpp"
#include "server/jobs/merge.hpp"
#include "server/jobs/part_helper.hpp"
#include "server/jobs/upload_source.hpp"
#include "server/metrics.hpp"

namespace cellmap::server {

struct JobQueueOptions {
  /// False: other servers over the same store carry out jobs; this one only takes them.
  bool carries_out = true;
  /// False: nobody sends scans to this server, so it leaves jobs that wait for scans to others.
  bool takes_scans = true;
  /// How long a job stays this server's after its last sign of life; it gives one three times as
  /// often. What a slow disk or network can take must be less.
  std::chrono::milliseconds lease = std::chrono::seconds(15);
  /// True where other processes reach the store: those that have no job make CELLs of the drives
  /// that others read, so that all work on one drive.
  bool shares_drives = true;
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
  std::uint64_t version = 0;  ///< differs after every change while the job is unfinished
  std::optional<JobHolder> holder;  ///< of an unfinished job
};

/// Runs jobs: drives that the server reads and merges one a map at a time, in order; drives that
/// robots send at once, side by side. Jobs stand in the store, where any number of servers claim
/// them (store/claims.hpp); a job whose server died or stopped goes on after its last stored CELL,
/// there or elsewhere. Thread safe. Every method throws Error{kNotFound} for a job or a map that is
/// not there.
class JobQueue {
 public:
  JobQueue(Maps& maps, Metrics& metrics, std::shared_ptr<spdlog::logger> log,
           JobQueueOptions options);
  /// Stops; running jobs are handed back.
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
  /// stops or another server has the job.
  UploadSource::Put put_scan(JobId id, PosedScan scan);
  JobView complete(JobId id);

  /// Returns when the job's version differs from `seen`, the job has ended, the queue stops, or
  /// time is up.
  JobView wait(JobId id, std::uint64_t seen, std::chrono::milliseconds timeout) const;

  bool has_unfinished(const std::string& map) const;
  struct Counts {
    std::size_t queued = 0;   ///< in the store, claimed by nobody or not begun here
    std::size_t running = 0;  ///< here
  };
  Counts unfinished() const;

  /// Stops taking and running jobs and hands them back; `wait` returns at once from now on. Blocks
  /// until all workers ended.
  void stop();
  bool is_stopping() const;

 private:
  struct LiveJob;
  using Job = std::shared_ptr<LiveJob>;

  // Taking and telling (job_queue.cpp).
  JobView enqueue(JobRecord record, bool alone, const Claims::FindSame& find_same);
  std::optional<JobId> no_other(const std::vector<HeldJob>& unfinished) const;
  void require_open() const;
  Job live(JobId id) const;  ///< null where this server has not claimed it
  Job upload_of(JobId id);
  std::optional<JobView> view_of_live(JobId id) const;
  JobView view_of(const HeldJob& job) const;
  static JobView view(const LiveJob& job);
  static JobView view(const JobRecord& record);

  // Claiming (job_claims.cpp).
  void keep_claiming();
  void claim_what_may_run();
  Job claim_one(std::optional<JobId> only);
  Job revive(const HeldJob& held) const;
  void send_heartbeats();
  void heed(const std::vector<HeldJob>& unfinished);
  void lose(LiveJob& job);
  void drop(LiveJob& job);

  // Carrying out (job_runs.cpp).
  void work();
  void run(LiveJob& job);
  void carry_out(LiveJob& job, const IngestHooks& hooks);
  void leave(LiveJob& job, const char* why);
  void end(LiveJob& job, JobState state, const std::string& code, const std::string& message);
  void touch(LiveJob& job);

  Maps& maps_;
  Store& store_;
  Claims& claims_;
  Metrics& metrics_;
  std::shared_ptr<spdlog::logger> log_;
  JobQueueOptions options_;
  const std::string worker_;  ///< this process, as claims name it
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  std::mutex claiming_;        ///< goes before `mutex_`: from claiming a job until it is live
  std::map<JobId, Job> live_;  ///< unfinished jobs that this server has claimed
  bool stopping_ = false;
  bool has_news_ = false;  ///< a job may have become claimable
  std::condition_variable news_;
  std::thread claimer_;
  std::vector<std::thread> workers_;
  std::unique_ptr<PartHelper> helper_;
};

}  // namespace cellmap::server
