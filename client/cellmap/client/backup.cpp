#include "cellmap/client/backup.hpp"

#include "cellmap/client/download.hpp"
#include "cellmap/client/range_source.hpp"
#include "cellmap/client/url.hpp"

namespace cellmap {

void download_backup(const ClientOptions& options, ByteFile& file, std::stop_token stop,
                     const ByteProgress& progress) {
  const std::string url = to_string(parse_server_url(options.url)) + "/v1/backup";
  const auto source = open_http_file(url, options);
  client::download(*source, file, stop, progress);
}

}  // namespace cellmap
