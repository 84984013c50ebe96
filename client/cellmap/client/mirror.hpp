#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>

#include "cellmap/client/client.hpp"

namespace cellmap {

/// A copy of a map in a folder, brought up to date through the server's list of changes.
///
///   mirror.json             which map of which server, at which revision; its CELLs and their
///   files pose-graph-<rev>.cpgr   poses and constraints at that revision (`decode_pose_graph`)
///   cells/<hash>.cell       the CELLs (`decode_cell`), named for their content
///
/// mirror.json is written last and names everything else, so a pull that is broken off leaves the
/// folder as it was before.
struct Mirror {
  std::string server;  ///< URL
  std::string map;
  Stamp map_created = 0;  ///< tells a map from a later one of the same name
  Revision revision = 0;
  std::map<CellId, CellRecord> cells;
  PoseGraph pose_graph;
};

/// What a pull did.
struct PullReport {
  Revision from = 0, to = 0;
  std::uint64_t cells = 0;    ///< of the map now
  std::uint64_t fetched = 0;  ///< of these, sent by the server (or taken from the cache) this time
  std::uint64_t fetched_bytes = 0;  ///< as FlatBuffers
  std::uint64_t moved = 0;
  std::uint64_t removed = 0;
  bool started_over = false;  ///< the folder's state did not fit the server's map
};

/// Brings `folder` up to date with a map; fetches only what changed since the last pull. Starts
/// over where the map was deleted and made again. Files of CELLs that are there with the right
/// content are not fetched again. Calls `on_cell(done, total)` after each CELL. Throws
/// Error{kConflict} where the folder mirrors another map or server, Error{kIo} where it cannot be
/// written, and what `Client` throws.
PullReport pull_map(Client& client, const std::string& map, const std::filesystem::path& folder,
                    const std::function<void(std::size_t done, std::size_t total)>& on_cell = {});

/// Reads a mirror's state. Throws Error{kNotFound} where the folder has none, Error{kCorruptData}
/// where it is damaged.
Mirror read_mirror(const std::filesystem::path& folder);

}  // namespace cellmap
