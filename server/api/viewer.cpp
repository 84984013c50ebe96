#include "server/api/viewer.hpp"

#include <array>
#include <fstream>
#include <iterator>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/core/hash.hpp"
#include "server/api/api.hpp"
#include "server/api/conditions.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"

// GET /, /assets/{file} and /api/: the viewer and the API reference, or a page that says how to
// build them.

namespace cellmap::server {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMaxViewerBytes = 16u << 20;

constexpr const char* kPolicy =
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; "
    "img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'";

constexpr const char* kLandingPage = R"(<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>CELLmap</title>
<style>
:root { color-scheme: light dark }
body { font: 1rem/1.5 system-ui, sans-serif; max-width: 40rem; margin: 3rem auto; padding: 0 1rem }
</style>
<h1>CELLmap</h1>
<p>A LiDAR map server: immutable CELLs, one pose graph a map.</p>
<p>The viewer is not built. With Node.js 20 or newer:
<code>cmake --build --preset release --target web</code>, then start the server again
(or name its folder: <code>cellmapd --viewer DIR</code>).</p>
<ul>
<li><a href="/v1/maps">Maps</a></li>
<li><a href="/openapi.yaml">The API (OpenAPI 3.1)</a>; its reference comes with the viewer</li>
<li><a href="/metrics">Metrics</a></li>
<li><a href="/healthz">Health</a> and <a href="/readyz">readiness</a></li>
</ul>
</html>
)";

Response landing_page() {
  Response page;
  page.headers.set("Content-Type", "text/html; charset=utf-8");
  page.headers.set("Content-Security-Policy",
                   "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; "
                   "form-action 'none'; frame-ancestors 'none'");
  page.body = std::string(kLandingPage);
  return page;
}

std::string type_of(const fs::path& file) {
  constexpr std::array<std::pair<const char*, const char*>, 7> kTypes{{
      {".html", "text/html; charset=utf-8"},
      {".js", "text/javascript; charset=utf-8"},
      {".css", "text/css; charset=utf-8"},
      {".svg", "image/svg+xml"},
      {".png", "image/png"},
      {".wasm", "application/wasm"},
      {".woff2", "font/woff2"},
  }};
  for (const auto& [suffix, type] : kTypes) {
    if (file.extension() == suffix) return type;
  }
  throw Error(ErrorCode::kUnsupported,
              "The viewer's folder holds a file of unknown type: " + file.string() + ".");
}

ViewerFile read_file(const fs::path& path) {
  ViewerFile file;
  file.type = type_of(path);
  std::ifstream stream(path, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(stream)), {});
  if (!stream) throw Error(ErrorCode::kIo, "Cannot read " + path.string() + ".");
  const auto content = as_bytes(text);
  file.etag = '"' + to_hex(sha256(content)).substr(0, 32) + '"';
  file.bytes = std::make_shared<const Bytes>(content.begin(), content.end());
  Bytes frame = zstd_compress(content);
  if (frame.size() < content.size()) file.frame = std::make_shared<const Bytes>(std::move(frame));
  return file;
}

void read_folder(const fs::path& folder, const std::string& prefix, ViewerFiles& files,
                 std::uintmax_t& bytes) {
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_symlink() || !entry.is_regular_file()) continue;
    bytes += entry.file_size();
    if (bytes > kMaxViewerBytes) {
      throw Error(ErrorCode::kTooLarge,
                  "The viewer in " + folder.string() + " has more than 16 MiB.");
    }
    files.emplace(prefix + entry.path().filename().string(), read_file(entry.path()));
  }
}

Response send_file(const Call& call, const ViewerFile& file, const char* caching) {
  Response response;
  response.headers.set("Content-Type", file.type);
  response.headers.set("Cache-Control", caching);
  response.headers.set("Vary", "Accept-Encoding");
  response.headers.set("Content-Security-Policy", kPolicy);
  response.headers.set("Referrer-Policy", "no-referrer");
  response.headers.set("Cross-Origin-Opener-Policy", "same-origin");
  const std::string zstd_etag = file.etag.substr(0, file.etag.size() - 1) + "-zstd\"";
  const bool zstd = file.frame && accepts_coding(call.header("Accept-Encoding"), "zstd");
  response.headers.set("ETag", zstd ? zstd_etag : file.etag);
  const auto condition = call.header("If-None-Match");
  if (condition && matches_etag(*condition, std::array{file.etag, zstd_etag})) {
    response.status = 304;
    return response;
  }
  if (zstd) response.headers.set("Content-Encoding", "zstd");
  const auto& body = zstd ? file.frame : file.bytes;
  response.body = SharedBytes{body, 0, body->size()};
  return response;
}

}  // namespace

ViewerFiles read_viewer(const fs::path& folder) try {
  ViewerFiles files;
  if (folder.empty()) return files;
  std::uintmax_t bytes = 0;
  if (!fs::is_regular_file(folder / "index.html")) {
    throw Error(ErrorCode::kNotFound, "There is no viewer in " + folder.string() +
                                          ": expected index.html and assets/ as web/run.sh build "
                                          "makes them.");
  }
  read_folder(folder, "", files, bytes);
  for (const char* name : {"assets", "api"}) {
    if (fs::is_directory(folder / name)) {
      read_folder(folder / name, std::string(name) + "/", files, bytes);
    }
  }
  return files;
} catch (const fs::filesystem_error& error) {
  throw Error(ErrorCode::kIo, "Cannot read the viewer: " + std::string(error.what()) + ".");
}

void add_viewer_routes(Router& router, Services& services) {
  const auto files = std::make_shared<const ViewerFiles>(read_viewer(services.options.viewer));
  router.add({"GET", "/", {}, 0, {"text/html"}, [files](const Call& call) {
                return files->empty() ? landing_page()
                                      : send_file(call, files->at("index.html"), "no-cache");
              }});
  // Names below assets/ hold a hash of their content.
  router.add({"GET", "/assets/{file}", {}, 0, {}, [files](const Call& call) {
                const auto file = files->find("assets/" + call.path("file"));
                if (file == files->end()) {
                  return problem(ErrorCode::kNotFound, "The viewer has no file of this name.");
                }
                return send_file(call, file->second, "public, max-age=31536000, immutable");
              }});
  router.add({"GET", "/api/", {}, 0, {"text/html"}, [files](const Call& call) {
                const auto page = files->find("api/index.html");
                if (page == files->end()) {
                  return problem(ErrorCode::kNotFound,
                                 "The API reference is built with the viewer: cmake --build "
                                 "--preset release --target web. /openapi.yaml says the same.");
                }
                return send_file(call, page->second, "no-cache");
              }});
  router.add({"GET", "/api", {}, 0, {}, [](const Call&) {
                Response response;
                response.status = 308;
                response.headers.set("Location", "api/");
                return response;
              }});
}

}  // namespace cellmap::server
