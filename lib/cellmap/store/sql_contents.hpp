#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/hash.hpp"
#include "cellmap/store/sql_connection.hpp"

namespace cellmap {

// Contents: the rows of `blob`, bytes that the CELLs of several maps may share. Whoever writes to a
// map has its rows for itself, but not these: one map may lose the last CELL of a content while
// another one gets its first. So a transaction first holds all contents that it is about to name or
// to leave, in the order of their hashes, whoever else wants some of them: nobody removes what is
// held to be named, and what is held to be left is named by nobody who has not committed. Only then
// it writes its CELLs, and removes last what no CELL names.

/// A content that a transaction is about to name.
struct NewContent {
  std::uint64_t encoded_bytes = 0;
  const Bytes* frame = nullptr;  ///< outlives the call
  bool is_object = false;        ///< the frame was put (store/blobs.hpp); its row only says so
};

/// Those of `hashes` that are there at the moment, with their encoded bytes.
std::map<ContentHash, std::uint64_t> find_contents(SqlConnection& connection,
                                                   const std::set<ContentHash>& hashes);

/// Until the transaction ends, all of `needed` are there, written where `there` has not seen them,
/// and nobody else begins to name any of `left`, which rows of this transaction's map name or did.
/// Throws `TakenBack` where somebody has removed meanwhile what `there` has seen.
void hold_contents(SqlConnection& connection, const std::map<ContentHash, NewContent>& needed,
                   const std::map<ContentHash, std::uint64_t>& there,
                   const std::set<ContentHash>& left);

/// What the CELLs of a map, or of one session of it, are kept as.
std::set<ContentHash> kept_contents(SqlConnection& connection, std::int64_t map,
                                    const std::optional<std::string>& session);
/// Removes those that no CELL has. They are held.
void remove_unused_contents(SqlConnection& connection, const std::set<ContentHash>& contents);

Bytes to_bytes(const ContentHash& hash);

}  // namespace cellmap
