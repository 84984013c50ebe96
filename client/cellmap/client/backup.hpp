#pragma once

#include "cellmap/client/archive.hpp"

namespace cellmap {

/// Writes a backup of all maps of a server, which goes on serving, into an empty file: a store.
/// Each part has the retries of `ClientOptions`. Throws what `Client` throws, Error{kCancelled}
/// when stopped.
void download_backup(const ClientOptions& options, ByteFile& file, std::stop_token stop = {},
                     const ByteProgress& progress = {});

}  // namespace cellmap
