#pragma once

#include <memory>
#include <string>

#include "cellmap/archive/byte_source.hpp"
#include "cellmap/client/client.hpp"

namespace cellmap {

/// True for "http://..." and "https://...".
bool is_http_url(const std::string& text);

/// The bytes at a URL of any web server that knows HTTP Range, for `ArchiveReader`. Every read but
/// the first names the file as the first found it (If-Match with its entity tag, else
/// If-Unmodified-Since), and what the answer says of it is compared too, for servers that ignore
/// conditions: where the file was replaced, Error{kPreconditionFailed}. Of `options` the address is
/// not used. Throws Error{kInvalidArgument} for an address that is none; reading
/// Error{kUnsupported} where the server does not answer with a range, and else what `Client`
/// throws.
std::unique_ptr<ByteSource> open_http_file(const std::string& url, ClientOptions options = {});

}  // namespace cellmap
