#include "server/jobs/part_helper.hpp"

#include <condition_variable>
#include <exception>
#include <mutex>
#include <utility>

#include "cellmap/pipeline/make_cells.hpp"
#include "server/jobs/ingest_request.hpp"
#include "server/jobs/shared_drive.hpp"

namespace cellmap::server {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kLookForParts(250);
/// Where there were parts, there will soon be more.
constexpr std::chrono::milliseconds kLookForMoreParts(20);
constexpr std::chrono::seconds kStayClose(3), kAvoid(60);

void sleep_unless_stopped(const std::stop_token& stop, std::chrono::milliseconds time) {
  std::mutex mutex;
  std::condition_variable_any never;
  std::unique_lock lock(mutex);
  never.wait_for(lock, stop, time, [] { return false; });
}

}  // namespace

/// The drive of a job as it is read here.
struct PartHelper::Drive {
  JobId job;
  IngestRequest request;
  std::shared_ptr<const Lattice> lattice;
  std::unique_ptr<ScanSource> source;
};

PartHelper::PartHelper(Maps& maps, Metrics& metrics, std::shared_ptr<spdlog::logger> log,
                       PartHelperOptions options)
    : maps_(maps),
      parts_(parts_of(maps.store())),
      metrics_(metrics),
      log_(std::move(log)),
      options_(std::move(options)),
      thread_([this](const std::stop_token& stop) { keep_helping(stop); }) {}

PartHelper::~PartHelper() = default;

void PartHelper::keep_helping(const std::stop_token& stop) {
  bool was_well = true;
  Clock::time_point last_helped{};
  while (!stop.stop_requested()) {
    try {
      if (options_.is_idle() && help_once(stop)) {
        last_helped = Clock::now();
        continue;
      }
      was_well = true;
    } catch (const std::exception& error) {
      if (was_well) log_->error("cannot help other workers: {}", error.what());
      was_well = false;
      drive_.reset();
    }
    const bool is_close = Clock::now() - last_helped < kStayClose;
    if (!is_close) drive_.reset();
    sleep_unless_stopped(stop, is_close ? kLookForMoreParts : kLookForParts);
  }
}

/// False where there is nothing to do.
bool PartHelper::help_once(const std::stop_token& stop) {
  std::erase_if(avoided_until_, [](const auto& job) { return job.second <= Clock::now(); });
  for (const JobId job : parts_.jobs_with_parts()) {
    if (avoided_until_.contains(job)) continue;
    if (const auto part = parts_.take_part(job, options_.worker)) {
      make(*part, stop);
      return true;
    }
  }
  return false;
}

void PartHelper::make(const JobPart& part, const std::stop_token& stop) {
  try {
    open(part.claim.job);
    std::vector<FinishedCell> cells;
    make_part(
        *drive_->source,
        FrontEnd(drive_->request.options, drive_->request.session, drive_->lattice),
        {part.first_sequence, part.first_scan, part.scan_count},
        [&](FinishedCell&& cell) {
          cells.push_back(std::move(cell));
          return true;
        },
        stop);
    const Bytes made = pack_part(cells);
    if (!parts_.deliver_part(part, options_.worker, made)) return;
    metrics_.part_made();
    log_->debug("job {}: made CELLs from {} on, {} bytes", part.claim.job.value,
                part.first_sequence, made.size());
  } catch (const std::exception& error) {
    parts_.give_back_part(part, options_.worker);
    if (stop.stop_requested()) return;
    drive_.reset();
    avoided_until_[part.claim.job] = Clock::now() + kAvoid;
    log_->info("job {} gets no help from here for a minute: {}", part.claim.job.value,
               error.what());
  }
}

void PartHelper::open(JobId job) {
  if (drive_ && drive_->job == job) return;
  drive_.reset();
  const JobRecord record = maps_.store().job(job);
  auto drive = std::make_unique<Drive>();
  drive->job = job;
  drive->request = parse_ingest_request(parse_json(record.request_json));
  set_threads(drive->request.options, options_.threads);
  drive->lattice = maps_.open(record.map)->lattice();
  drive->source = open_request(drive->request, options_.data_roots);
  drive_ = std::move(drive);
}

}  // namespace cellmap::server
