#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <random>

#include "cellmap/client/puller.hpp"

namespace cellmap {
namespace client {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kLongPoll{10'000};  // a stop waits for its end
constexpr milliseconds kPoll{5'000};       // of servers that know nothing better

/// Returns early, with false, where a stop is requested.
bool wait_for(milliseconds time, std::stop_token stop) {
  std::mutex mutex;
  std::unique_lock lock(mutex);
  std::condition_variable_any never;
  never.wait_for(lock, stop, time, [] { return false; });
  return !stop.stop_requested();
}

/// One folder that follows one map.
class Following {
 public:
  Following(Client& client, const std::string& map, const std::filesystem::path& folder,
            const FollowOptions& options, std::stop_token stop)
      : client_(client),
        map_(map),
        options_(options),
        pull_(options.pull),
        stop_(std::move(stop)),
        puller_(client, map, folder) {}

  void run() {
    while (!stop_.stop_requested()) {
      try {
        pull();
        wait_for_news();
      } catch (const Error& error) {
        if (!may_pass(error.code())) throw;
        const milliseconds delay = next_delay();
        if (options_.on_away) options_.on_away(error, delay);
        wait_for(delay, stop_);
      }
    }
  }

 private:
  void pull(std::optional<Changes> given = {}) {
    if (options_.where) {
      if (const auto now = options_.where()) place_ = now;
      pull_.near = place_;
    }
    const PullReport report = puller_.pull(pull_, std::move(given));
    failures_ = 0;
    const bool news = first_ || report.started_over || report.to != report.from ||
                      report.fetched > 0 || report.evicted > 0;
    first_ = false;
    if (news && options_.on_pull) options_.on_pull(report);
  }

  /// Until the next pull is due, as far as the server lets itself be followed.
  void wait_for_news() {
    const auto begun = std::chrono::steady_clock::now();
    const auto on_event = [&](const std::optional<RevisionEvent>& event) {
      const bool news = event && (event->revision != puller_.revision() ||
                                  !is_same_creation(event->map_created, puller_.map_created()));
      if (news || has_moved()) pull();
      return !stop_.stop_requested();
    };
    if (!client_.follow_revisions(map_, puller_.revision(), on_event, stop_)) return long_poll();
    // The server ended it. Not again at once, because one that stops still answers for a while.
    const auto lasted = std::chrono::steady_clock::now() - begun;
    if (lasted < options_.first_delay) wait_for(options_.first_delay, stop_);
  }

  void long_poll() {
    if (stop_.stop_requested() || has_moved()) return;
    try {
      pull(client_.changes(map_, puller_.revision(), options_.where ? kPoll : kLongPoll));
    } catch (const Error& error) {
      if (error.code() == ErrorCode::kNotFound) return;  // the pull says which map is gone
      if (error.code() != ErrorCode::kInvalidArgument) throw;
      wait_for(kPoll, stop_);  // a server that cannot wait
    }
  }

  bool has_moved() const {
    if (!options_.where) return false;
    const auto now = options_.where();
    return now && (!place_ || (*now - *place_).norm() >= options_.moved_m);
  }

  /// Drawn evenly from the upper half, so that robots that lost one server do not all come back at
  /// once.
  milliseconds next_delay() {
    milliseconds delay = options_.first_delay;
    for (int i = 0; i < failures_ && delay < options_.max_delay; ++i) delay *= 2;
    ++failures_;
    delay = std::min(delay, options_.max_delay);
    return milliseconds(std::uniform_int_distribution<milliseconds::rep>(delay.count() / 2,
                                                                         delay.count())(random_));
  }

  Client& client_;
  const std::string& map_;
  const FollowOptions& options_;
  PullOptions pull_;
  std::stop_token stop_;
  Puller puller_;
  std::optional<Eigen::Vector3d> place_ = options_.pull.near;  ///< of the robot at the last pull
  bool first_ = true;
  int failures_ = 0;
  std::mt19937_64 random_{std::random_device()()};
};

}  // namespace
}  // namespace client

void FollowOptions::validate() const {
  PullOptions checked = pull;
  if (where) checked.near = Eigen::Vector3d::Zero();
  checked.validate();
  if (!(moved_m > 0) || first_delay.count() <= 0 || max_delay < first_delay) {
    throw Error(ErrorCode::kInvalidArgument,
                "following needs moved_m above 0 and 0 < first_delay <= max_delay");
  }
}

void follow_map(Client& client, const std::string& map, const std::filesystem::path& folder,
                const FollowOptions& options, std::stop_token stop) {
  options.validate();
  client::Following(client, map, folder, options, std::move(stop)).run();
}

}  // namespace cellmap
