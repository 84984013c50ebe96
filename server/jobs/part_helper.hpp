#pragma once

#include <spdlog/logger.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "cellmap/store/parts.hpp"
#include "server/api/map_state.hpp"
#include "server/metrics.hpp"

namespace cellmap::server {

struct PartHelperOptions {
  std::string worker;                             ///< as claims name it
  std::vector<std::filesystem::path> data_roots;  ///< canonical
  int threads = 1;                                ///< of a part's computations; 0: all
  std::function<bool()> is_idle;                  ///< whether there is nothing of one's own to do
};

/// Makes parts of other workers' drives (jobs/shared_drive.hpp) on a thread of its own while there
/// is nothing else to do. The drives must lie below the data roots here too; where one does not, or
/// the request is not understood, the part is given back and the job left to others for a minute.
class PartHelper {
 public:
  PartHelper(Maps& maps, Metrics& metrics, std::shared_ptr<spdlog::logger> log,
             PartHelperOptions options);
  /// Stops; a part that is being made is given back.
  ~PartHelper();

 private:
  struct Drive;

  void keep_helping(const std::stop_token& stop);
  bool help_once(const std::stop_token& stop);
  void make(const JobPart& part, const std::stop_token& stop);
  void open(JobId job);

  Maps& maps_;
  Parts& parts_;
  Metrics& metrics_;
  std::shared_ptr<spdlog::logger> log_;
  PartHelperOptions options_;
  std::unique_ptr<Drive> drive_;  ///< of the last part
  std::map<JobId, std::chrono::steady_clock::time_point> avoided_until_;
  std::jthread thread_;
};

}  // namespace cellmap::server
