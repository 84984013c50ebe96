#pragma once

#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>

#include "cellmap/archive/archive_writer.hpp"
#include "cellmap/archive/byte_source.hpp"
#include "cellmap/client/client.hpp"

namespace cellmap {

/// Bytes done, of so many.
using ByteProgress = std::function<void(std::uint64_t, std::uint64_t)>;

/// Writes the archive that a server makes of a map into an empty file, in parts, each with the
/// retries of `ClientOptions`. A map that changes meanwhile is fetched anew, a few times. Throws
/// what `Client` throws, Error{kCancelled} when stopped.
void download_archive(const ClientOptions& options, const std::string& map,
                      const ArchiveOptions& archive, ByteFile& file, std::stop_token stop = {},
                      const ByteProgress& progress = {});

/// Makes a map of an archive, which is sent as it is read, piece by piece. Error{kAlreadyExists}
/// where the name is taken, Error{kCorruptData} where the server finds damage. One attempt.
MapInfo upload_archive(const ClientOptions& options, const std::string& map, ByteSource& archive);

}  // namespace cellmap
