#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>

#include "cellmap/codec/cell_codec.hpp"

namespace cellmap::server {

/// One file of the built viewer, ready to be sent.
struct ViewerFile {
  std::string type;  ///< Content-Type
  std::string etag;  ///< strong, with its quotes
  std::shared_ptr<const Bytes> bytes;
  std::shared_ptr<const Bytes> frame;  ///< the same as a zstd frame; null where that is no shorter
};

/// Files by name: `index.html`, and below `assets/` and `api/`.
using ViewerFiles = std::map<std::string, ViewerFile>;

/// Reads a folder that `web/run.sh build` made: index.html, assets/ and api/, no other folder, no
/// link, at most 16 MiB. So what is served is what was there at the start, and no path of a request
/// ever reaches the file system. Empty where `folder` is empty. Throws Error{kNotFound} where there
/// is no index.html, {kUnsupported} for a file of unknown type, {kTooLarge}, {kIo}.
ViewerFiles read_viewer(const std::filesystem::path& folder);

}  // namespace cellmap::server
