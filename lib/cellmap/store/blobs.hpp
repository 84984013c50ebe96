#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/store/object_store.hpp"
#include "cellmap/store/sql_connection.hpp"

namespace cellmap {

/// What the tables have of the kept bytes of a CELL.
struct BlobRow {
  std::shared_ptr<const Bytes> frame;         ///< null where it is an object
  ContentHash checksum;                       ///< SHA-256 of the frame; names the object
  std::optional<std::uint64_t> object_bytes;  ///< size of the frame where it is an object
};

/// Where a store's frames go: into its tables, or into an object store beside them, where each is
/// an object named by its own SHA-256. What is read may lie in either, each row says so; so an
/// object store may be added to a database that has CELLs already.
///
/// An object is put before its row is committed, so a row that can be seen has one. What no row
/// names (any more) stays and harms nobody. Thread safe.
class Blobs {
 public:
  /// Without options: in the tables.
  explicit Blobs(const std::optional<ObjectStoreOptions>& objects);

  bool are_objects() const { return objects_ != nullptr; }
  /// Where frames go to objects, puts these, several at a time. Errors as ObjectStore.
  void put(const std::vector<const Bytes*>& frames) const;
  /// The frame of a row, compared with its checksum. Error{kCorruptData} where it is damaged or
  /// missing, {kUnsupported} where it is an object and no object store was named; ObjectStore's.
  std::shared_ptr<const Bytes> frame_of(const ContentHash& content, const BlobRow& row) const;
  /// Throws where the object store does not answer.
  void check_ready() const;

 private:
  std::unique_ptr<ObjectStore> objects_;
};

/// Error{kCorruptData} where there is no such row.
BlobRow read_blob_row(SqlConnection& connection, const ContentHash& content);

}  // namespace cellmap
