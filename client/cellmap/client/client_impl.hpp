#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "cellmap/client/client.hpp"
#include "cellmap/client/files.hpp"
#include "cellmap/client/json.hpp"
#include "cellmap/client/transport.hpp"
#include "cellmap/codec/zstd.hpp"

// What the sources of `Client` share. Not installed.

namespace cellmap {
namespace client {

inline constexpr char kCellType[] = "application/vnd.cellmap.cell";
inline constexpr char kScanType[] = "application/vnd.cellmap.scan";

inline std::string map_path(const std::string& map) { return "/v1/maps/" + percent_encoded(map); }
inline std::string session_path(const std::string& map, const std::string& session) {
  return map_path(map) + "/sessions/" + percent_encoded(session);
}

inline HttpRequest json_request(std::string method, std::string path, const Json& body) {
  HttpRequest request{std::move(method), std::move(path), {}, dump(body, false)};
  request.headers = {{"content-type", "application/json"}, {"accept", "application/json"}};
  return request;
}

}  // namespace client

struct Client::Impl {
  explicit Impl(ClientOptions checked) : options(std::move(checked)), transport(options) {
    if (!options.cache_directory.empty()) {
      cache.emplace(CellCacheOptions{options.cache_directory, options.cache_max_bytes});
    }
  }

  client::Json get_json(const std::string& path) {
    client::HttpRequest request{"GET", path, {{"accept", "application/json"}}, ""};
    return client::parse_json(transport.perform(request).body);
  }
  client::Json send_json(const client::HttpRequest& request) {
    return client::parse_json(transport.perform(request).body);
  }
  std::string get_text(const std::string& path) {
    return transport.perform({"GET", path, {}, ""}).body;
  }
  /// Puts a body into a request, compressed as the options say.
  void set_body(client::HttpRequest& request, const Bytes& bytes, const char* type) const {
    request.headers["content-type"] = type;
    if (options.compression_level == 0) {
      request.body = client::as_text(bytes);
      return;
    }
    request.headers["content-encoding"] = "zstd";
    request.body = client::as_text(zstd_compress(bytes, options.compression_level));
  }
  /// Where hints on ETags are kept.
  std::string cache_key(const std::string& map) const {
    return to_string(transport.url()) + client::map_path(map);
  }
  CellBatch batch(const std::string& map, const client::Json& wanted);

  ClientOptions options;
  client::Transport transport;
  std::optional<CellCache> cache;
};

}  // namespace cellmap
