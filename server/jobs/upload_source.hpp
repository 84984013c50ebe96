#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <stop_token>

#include "cellmap/scan/scan_source.hpp"

namespace cellmap::server {

struct UploadOptions {
  std::size_t max_scans = 16;          ///< scans that wait; more are refused
  std::size_t max_points = 4'000'000;  ///< and their points, unless the queue is empty
  /// How long `put` waits for room: a client that comes back later leaves the job without work.
  std::chrono::milliseconds room_timeout = std::chrono::seconds(1);
  std::chrono::milliseconds idle_timeout = std::chrono::minutes(10);
};

/// A drive whose scans a client sends, in order, into a bounded queue; the job reads it as any
/// other source. One job reads; any thread may put.
class UploadSource : public ScanSource {
 public:
  UploadSource(std::uint64_t scans_total, std::uint64_t first_scan, std::stop_token stop,
               const UploadOptions& options);

  enum class Put { kTaken, kHadAlready, kOutOfOrder, kFull, kEnded };
  /// Blocks while the queue is full, for at most `room_timeout`.
  Put put(PosedScan scan);
  /// No more scans will come.
  void complete();
  bool is_complete() const;
  /// Whether `next` gave up because no scan came.
  bool was_idle() const;
  /// Index of the scan that `put` expects.
  std::uint64_t next_scan() const;
  /// How many scans `put` would take now without waiting, as far as their points fit too.
  std::size_t room() const;

  std::size_t size() const override { return scans_total_; }
  /// Blocks. Throws Error{kCancelled} when stopped and Error{kUnavailable} where no scan comes in
  /// time.
  std::optional<PosedScan> next() override;
  void interrupt() override;
  /// Scans from `index` on that wait already are kept.
  void seek(std::size_t index) override;
  const Trajectory& ground_truth() const override { return no_truth_; }

 private:
  bool has_room(std::size_t points) const;
  void drop_first();

  std::uint64_t scans_total_;
  std::stop_token stop_;
  UploadOptions options_;
  Trajectory no_truth_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<PosedScan> queue_;
  std::size_t queued_points_ = 0;
  std::uint64_t next_scan_;
  bool complete_ = false;
  bool was_idle_ = false;
  bool interrupted_ = false;
};

}  // namespace cellmap::server
