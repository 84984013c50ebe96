#include "server/jobs/upload_source.hpp"

#include <algorithm>

#include "cellmap/core/error.hpp"
#include "cellmap/core/progress.hpp"

namespace cellmap::server {

UploadSource::UploadSource(std::uint64_t scans_total, std::uint64_t first_scan,
                           std::stop_token stop, const UploadOptions& options)
    : scans_total_(scans_total),
      stop_(std::move(stop)),
      options_(options),
      next_scan_(first_scan) {}

UploadSource::Put UploadSource::put(PosedScan scan) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, stop_, options_.room_timeout, [&] {
    return complete_ || scan.index != next_scan_ || has_room(scan.points.size());
  });
  if (scan.index < next_scan_) return Put::kHadAlready;
  if (complete_) return Put::kEnded;
  if (scan.index > next_scan_) return Put::kOutOfOrder;
  if (!has_room(scan.points.size())) return Put::kFull;
  queued_points_ += scan.points.size();
  queue_.push_back(std::move(scan));
  ++next_scan_;
  changed_.notify_all();
  return Put::kTaken;
}

bool UploadSource::has_room(std::size_t points) const {
  return queue_.empty() ||
         (queue_.size() < options_.max_scans && queued_points_ + points <= options_.max_points);
}

void UploadSource::drop_first() {
  queued_points_ -= queue_.front().points.size();
  queue_.pop_front();
  changed_.notify_all();
}

void UploadSource::complete() {
  const std::lock_guard lock(mutex_);
  complete_ = true;
  changed_.notify_all();
}

bool UploadSource::is_complete() const {
  const std::lock_guard lock(mutex_);
  return complete_;
}

bool UploadSource::was_idle() const {
  const std::lock_guard lock(mutex_);
  return was_idle_;
}

std::uint64_t UploadSource::next_scan() const {
  const std::lock_guard lock(mutex_);
  return next_scan_;
}

std::size_t UploadSource::room() const {
  const std::lock_guard lock(mutex_);
  if (queue_.empty()) return std::max<std::size_t>(options_.max_scans, 1);
  const bool is_full = queue_.size() >= options_.max_scans || queued_points_ >= options_.max_points;
  return is_full ? 0 : options_.max_scans - queue_.size();
}

std::optional<PosedScan> UploadSource::next() {
  std::unique_lock lock(mutex_);
  const bool woken = changed_.wait_for(lock, stop_, options_.idle_timeout, [&] {
    return interrupted_ || complete_ || !queue_.empty();
  });
  throw_if_stopped(stop_);
  if (interrupted_) throw Error(ErrorCode::kCancelled, "nobody reads the scans any more");
  if (!woken) {
    was_idle_ = true;
    throw Error(ErrorCode::kUnavailable,
                "No scan came for " + std::to_string(options_.idle_timeout.count() / 1000) +
                    " s; whole CELLs are kept, post the session again to go on.");
  }
  if (queue_.empty()) return std::nullopt;
  std::optional<PosedScan> scan = std::move(queue_.front());
  drop_first();
  return scan;
}

void UploadSource::interrupt() {
  const std::lock_guard lock(mutex_);
  interrupted_ = true;
  changed_.notify_all();
}

void UploadSource::seek(std::size_t index) {
  const std::lock_guard lock(mutex_);
  while (!queue_.empty() && queue_.front().index != index) {
    drop_first();
  }
  if (queue_.empty()) next_scan_ = index;
}

}  // namespace cellmap::server
