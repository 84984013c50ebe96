#include "cellmap/client/archive.hpp"

#include <nlohmann/json.hpp>

#include "cellmap/client/client_impl.hpp"
#include "cellmap/client/json.hpp"
#include "cellmap/client/range_source.hpp"
#include "cellmap/client/transport.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/core/progress.hpp"

namespace cellmap {
namespace {

constexpr char kArchiveType[] = "application/vnd.cellmap.archive";
constexpr std::size_t kPieceBytes = 4u << 20;
constexpr int kAttempts = 5;

std::string archive_path(const std::string& map) { return client::map_path(map) + "/archive"; }

std::string query_of(const ArchiveOptions& options) {
  std::string query = "?encoding=" + std::string(to_string(options.encoding));
  if (options.encoding == ArchiveEncoding::kCompact) {
    query += "&bound=" + client::dump(client::Json(options.bound_m), false);
  }
  return query;
}

void copy(ByteSource& from, ByteFile& to, const std::stop_token& stop,
          const ByteProgress& progress) {
  from.restart();
  to.resize(0);
  const std::uint64_t size = from.size();
  for (std::uint64_t done = 0; done < size;) {
    throw_if_stopped(stop);
    const Bytes piece = from.read(done, kPieceBytes);
    to.write(done, piece);
    done += piece.size();
    if (progress) progress(done, size);
  }
}

}  // namespace

void download_archive(const ClientOptions& options, const std::string& map,
                      const ArchiveOptions& archive, ByteFile& file, std::stop_token stop,
                      const ByteProgress& progress) {
  const ServerUrl server = parse_server_url(options.url);
  const auto source =
      open_http_file(to_string(server) + archive_path(map) + query_of(archive), options);
  for (int attempt = 1;; ++attempt) {
    try {
      copy(*source, file, stop, progress);
      return;
    } catch (const Error& error) {
      if (error.code() != ErrorCode::kPreconditionFailed || attempt == kAttempts) throw;
    }
  }
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
