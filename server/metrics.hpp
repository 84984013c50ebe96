#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace cellmap::server {

/// What is counted when somebody looks, rather than when it happens: in the store,
struct StoreCounts {
  std::size_t maps = 0;
  std::uint64_t cells = 0, scans = 0;
  std::uint64_t cell_bytes = 0;  ///< of CELLs as the store keeps them
  std::size_t queued_jobs = 0, running_jobs = 0;
};

/// and beside it.
struct MetricsSnapshot {
  std::optional<StoreCounts> store;  ///< nothing where the store does not answer
  std::uint64_t store_bytes = 0;     ///< of the store's files
  std::uint64_t place_bytes = 0;     ///< of what is known of places, in memory
  std::size_t tokens = 0;
};

/// What the server counts, as Prometheus text. Thread safe.
class Metrics {
 public:
  Metrics();
  ~Metrics();

  /// `route` is a pattern, never a path: the number of label values is bounded.
  void request(std::string_view route, std::string_view method, int status, double seconds,
               std::size_t bytes_out);
  void relocalisation(bool found);
  /// Another server, by its URL, was asked to search its regions: "answered", "failed", or
  /// "left_alone" because it failed a moment ago.
  void place_server_asked(const std::string& server, const std::string& outcome);
  void place_regions_taken_over(std::size_t count);  ///< searched instead of the others
  void cells_committed(std::size_t count);
  void part_made();  ///< of another worker's drive
  void job_ended(const std::string& state);
  void set_followers(int count);
  void audit_failed();  ///< a write is missing in the audit log
  void tokens_reloaded(bool good);

  /// With what the operating system says of this process.
  std::string text(const MetricsSnapshot& snapshot) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap::server
