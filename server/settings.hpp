#pragma once

#include <iosfwd>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "cellmap/store/object_store.hpp"
#include "server/api/place_servers.hpp"

namespace cellmap::server {

/// What cellmapd was told. Each has one name: `log-level` in the file, CELLMAPD_LOG_LEVEL in the
/// environment, --log-level on the command line. The command line goes before the environment, that
/// before the file, that before the defaults here.
struct Settings {
  std::string store;
  /// s3://BUCKET[/PREFIX] for the bytes of CELLs; its keys stand in the environment alone.
  std::string blobs, blobs_endpoint, blobs_region = "us-east-1";
  /// Of the servers of one database: "api" takes jobs, "worker" carries them out and answers
  /// nothing but how it is.
  std::string role = "all";
  double job_lease_s = 15;
  std::vector<std::string> listen{"127.0.0.1:8080"};
  std::vector<std::string> data_roots;
  std::string viewer;
  std::string tokens, audit;
  double rate_limit = 0;
  std::vector<std::string> allow_origins;
  std::vector<std::string> trusted_proxies;
  int threads = 0;
  std::size_t place_memory_mib = 4096;
  /// URLs of the servers of one database that hold the index of places together, and which of them
  /// this one is.
  std::vector<std::string> place_servers;
  std::string place_self;
  double place_timeout_s = 2;
  std::size_t place_alone = kCompareAll;
  int max_connections = 4096;
  std::string log_level = "info", log_format = "text";
  bool insecure = false;
};

/// Settings, or the exit code of a program that has nothing more to do: it printed its help, its
/// version, its configuration (--print-config) to `out`, or what was wrong to `err` (code 2). What
/// nobody knows is refused, in the file too.
std::variant<Settings, int> read_settings(const std::vector<std::string>& arguments,
                                          std::ostream& out, std::ostream& err);

/// Where the bytes of CELLs go beside the database; nullopt: into it. Throws
/// Error{kInvalidArgument} for a file, which has them itself, and for what cannot be, such as keys
/// that are missing in the environment.
std::optional<ObjectStoreOptions> objects_of(const Settings& settings);

/// Throws Error{kInvalidArgument} where a server of a file, which has only one, would not do all.
void check_role(const Settings& settings);

/// The servers that hold the index of places together; none where there are no others. Throws
/// Error{kInvalidArgument} for what is no URL of a server or there twice, where this server is none
/// of them, and where it is one of a file, or a worker, which has no others or answers none.
PlaceServersOptions place_servers_of(const Settings& settings);

/// Throws Error{kInvalidArgument} where others than this machine could reach the server and nobody
/// would be asked who they are.
void check_addresses(const Settings& settings);

}  // namespace cellmap::server
