#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "cellmap/client/resources.hpp"
#include "cellmap/codec/kept_cell.hpp"

namespace cellmap {

/// A copy of a map in a folder (`pull_map` makes it and brings it up to date), good to work with
/// when the server is away.
///
///   mirror.json             which map of which server, at which revision; its CELLs and their
///   files pose-graph-<rev>.cpgr   poses and constraints at that revision (`decode_pose_graph`)
///   cells/<hash>.cell       CELLs (`decode_cell`), named for their content: all of the map, or
///                           those near the robot
///   cells/<hash>.ccod       the same in few bytes (`decode_coded_cell`): the CELL of that hash in
///                           the bytes in which its map keeps it, or coded from it on its way
///
/// mirror.json is written last and names everything else, so a pull that is broken off leaves the
/// folder as it was before. One process at a time writes to a folder, any number may read it.
struct Mirror {
  std::string server;  ///< URL
  std::string map;
  Stamp map_created = 0;  ///< tells a map from a later one of the same name
  MapInfo info;           ///< as the server gave it when the mirror was begun: its counts are old
  CellForm form;          ///< in which the last pull fetched CELLs
  Revision revision = 0;
  std::map<CellId, CellRecord> cells;  ///< all of the map, also those whose bytes are not here
  PoseGraph pose_graph;
};

/// Reads a mirror's state. Throws Error{kNotFound} where the folder has none, Error{kCorruptData}
/// where it is damaged, Error{kUnsupported} where another version wrote it.
Mirror read_mirror(const std::filesystem::path& folder);

/// The same, but nullopt where the folder has none.
std::optional<Mirror> find_mirror(const std::filesystem::path& folder);

/// Replaces the folder's state, as a whole or not at all. Throws Error{kIo}.
void write_mirror(const Mirror& mirror, const std::filesystem::path& folder);

/// Where the CELL of a hash is kept in a form, whether it is there or not.
std::filesystem::path mirror_cell_file(const std::filesystem::path& folder, const ContentHash& hash,
                                       const CellForm& form = {});

/// The file that holds the CELL of a hash: the whole one where there are two.
std::optional<std::filesystem::path> find_mirrored_cell(const std::filesystem::path& folder,
                                                        const ContentHash& hash);

/// The raw bytes of a CELL, verified against its hash, or, where it was coded on its way, of what
/// it decodes to, with a hash of its own; nullopt where it is not in the folder. Throws
/// Error{kCorruptData} where its file is damaged, saying what to do.
std::optional<EncodedCell> read_mirrored_cell(const std::filesystem::path& folder,
                                              const ContentHash& hash);

/// The same with the coded bytes, where it is kept in such.
std::optional<KeptCell> read_mirrored_kept_cell(const std::filesystem::path& folder,
                                                const ContentHash& hash);

/// Brings a mirror from `changes.since`, which must be its revision, to `changes.revision`. Throws
/// Error{kCorruptData} where they do not fit it.
void apply_changes(const Changes& changes, Mirror& mirror);

}  // namespace cellmap
