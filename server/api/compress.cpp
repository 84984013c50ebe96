#include "server/api/compress.hpp"

#include "cellmap/codec/zstd.hpp"
#include "server/api/conditions.hpp"

namespace cellmap::server {
namespace {

constexpr std::size_t kThinLinkBytes = 256u << 10;
constexpr int kThinLinkLevel = 19, kLevel = 3;

}  // namespace

void compress_if_accepted(const Call& call, Response& response) {
  response.headers.add("Vary", "Accept-Encoding");
  if (!accepts_coding(call.header("Accept-Encoding"), "zstd")) return;
  const auto body = body_view(response);
  Bytes frame =
      zstd_compress(as_bytes(body), body.size() < kThinLinkBytes ? kThinLinkLevel : kLevel);
  if (frame.size() >= body.size()) return;
  response.headers.set("Content-Encoding", "zstd");
  const auto shared = std::make_shared<const Bytes>(std::move(frame));
  response.body = SharedBytes{shared, 0, shared->size()};
}

}  // namespace cellmap::server
