#pragma once

#include <spdlog/logger.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/codec/place_search_codec.hpp"
#include "cellmap/place/region_owners.hpp"
#include "server/api/seldom.hpp"
#include "server/metrics.hpp"

namespace cellmap::server {

inline constexpr const char* kPlaceQueryType = "application/vnd.cellmap.place-query";
inline constexpr const char* kPlaceAnswerType = "application/vnd.cellmap.place-answer";

/// Servers of one database that hold the index of places together.
struct PlaceServersOptions {
  std::vector<std::string> servers;  ///< URLs of all of them, everywhere the same; empty: none
  std::string self;                  ///< the one of them that this server is
  std::chrono::milliseconds timeout = std::chrono::seconds(2);  ///< for an answer
  std::chrono::milliseconds pause = std::chrono::seconds(5);    ///< after one that was none
  std::size_t alone = kCompareAll;  ///< as many CELLs are searched by whoever is asked
};

/// For whom a server asks another: what the other needs to let him in and to name him in its log.
struct OnBehalfOf {
  std::string request_id;
  std::optional<std::string> authorization;
  std::string address;
};

/// A server that is asked to search its regions. Thread safe.
class PlaceServer {
 public:
  using Deadline = std::chrono::steady_clock::time_point;

  PlaceServer(std::string url, const PlaceServersOptions& options, Metrics& metrics,
              std::shared_ptr<spdlog::logger> log);

  /// While it is left alone, because it gave no answer a moment ago.
  bool is_left_alone() const;
  /// Blocks until it has answered, or a little longer than the deadline. nullopt where it gave no
  /// good answer: that is logged now and then, counted, and where it was the server's fault it is
  /// left alone for a while.
  std::optional<PlaceAnswer> ask(const std::string& map, const PlaceQuery& query,
                                 const OnBehalfOf& caller, Deadline deadline);
  /// It gave no answer, or one to something else.
  void failed(const std::string& why, bool leave_alone = true);

 private:
  struct Reply;
  Reply post(const std::string& path, const Bytes& body, const OnBehalfOf& caller,
             Deadline deadline) const;

  const std::string url_;
  const std::chrono::milliseconds pause_;
  Metrics& metrics_;
  const std::shared_ptr<spdlog::logger> log_;
  Seldom says_why_;
  std::atomic<Deadline::rep> alone_until_ = 0;
};

class PlaceServers {
 public:
  PlaceServers(PlaceServersOptions options, Metrics& metrics,
               const std::shared_ptr<spdlog::logger>& log);

  /// Whether a search of so many CELLs is shared out among them.
  bool share(std::size_t cells) const { return others() > 0 && cells > options_.alone; }
  std::size_t others() const { return servers_.empty() ? 0 : servers_.size() - 1; }
  const PlaceServersOptions& options() const { return options_; }
  /// Of the regions of a map: places in the list of servers. At least one server.
  RegionOwners owners(const std::string& map) const { return {options_.servers, map}; }
  std::size_t self() const { return self_; }
  PlaceServer& server(std::size_t i) const { return *servers_[i]; }

 private:
  const PlaceServersOptions options_;
  std::vector<std::unique_ptr<PlaceServer>> servers_;
  std::size_t self_ = 0;
};

}  // namespace cellmap::server
