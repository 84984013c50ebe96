#include "cellmap/client/archive.hpp"

#include <nlohmann/json.hpp>

#include "cellmap/client/client_impl.hpp"
#include "cellmap/client/download.hpp"
#include "cellmap/client/json.hpp"
#include "cellmap/client/range_source.hpp"
#include "cellmap/client/transport.hpp"

namespace cellmap {
namespace {

constexpr char kArchiveType[] = "application/vnd.cellmap.archive";
constexpr std::size_t kPieceBytes = 4u << 20;

std::string archive_path(const std::string& map) { return client::map_path(map) + "/archive"; }

std::string query_of(const ArchiveOptions& options) {
  std::string query = "?encoding=" + std::string(to_string(options.encoding));
  if (options.encoding == ArchiveEncoding::kCompact) {
    query += "&bound=" + client::dump(client::Json(options.bound_m), false);
  }
  return query;
}

}  // namespace

void download_archive(const ClientOptions& options, const std::string& map,
                      const ArchiveOptions& archive, ByteFile& file, std::stop_token stop,
                      const ByteProgress& progress) {
  const ServerUrl server = parse_server_url(options.url);
  const auto source =
      open_http_file(to_string(server) + archive_path(map) + query_of(archive), options);
  client::download(*source, file, stop, progress);
}

MapInfo upload_archive(const ClientOptions& options, const std::string& map, ByteSource& archive) {
  options.validate();
  client::HttpRequest request{"PUT", archive_path(map), {}, ""};
  request.headers = {{"content-type", kArchiveType}, {"accept", "application/json"}};
  request.idempotent = false;
  request.large_body =
      client::LargeBody{archive.size(), [&](std::uint64_t offset, std::size_t length) {
                          const Bytes piece = archive.read(offset, std::min(length, kPieceBytes));
                          return std::string(client::as_text(piece));
                        }};
  client::Transport transport(options);
  return client::map_info_from_json(client::parse_json(transport.perform(request).body));
}

}  // namespace cellmap
