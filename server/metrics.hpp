#pragma once

#include <cstddef>
#include <memory>
#include <string>

namespace cellmap::server {

/// What the server counts, as Prometheus text. Thread safe.
class Metrics {
 public:
  Metrics();
  ~Metrics();

  /// `route` is a pattern, never a path: the number of label values is bounded.
  void request(const std::string& route, const std::string& method, int status, double seconds,
               std::size_t bytes_out);
  void relocalisation(bool found);
  void cells_committed(std::size_t count);
  void job_ended(const std::string& state);
  void set_running_jobs(int count);
  void set_followers(int count);

  std::string text() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap::server
