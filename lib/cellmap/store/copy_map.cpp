#include "cellmap/store/copy_map.hpp"

#include <string_view>
#include <utility>
#include <vector>

#include "cellmap/store/sql_cells.hpp"
#include "cellmap/store/sql_reads.hpp"
#include "cellmap/store/sql_store.hpp"
#include "cellmap/store/update_context.hpp"

namespace cellmap {
namespace {

using enum SqlType;

struct Column {
  const char* name;
  SqlType type;
};

/// A table of which every row belongs to a map, without the column that says which.
struct Table {
  const char* name;
  std::vector<Column> columns;
};

/// In an order that holds foreign keys.
std::vector<Table> tables() {
  return {{"session",
           {{"name", kText},
            {"robot", kText},
            {"sensor", kText},
            {"odometry_frame", kText},
            {"started", kInteger},
            {"aligned", kInteger}}},
          {"cell",
           {{"hash", kBytes},
            {"id", kInteger},
            {"session", kText},
            {"sequence", kInteger},
            {"planes", kInteger},
            {"encoded_bytes", kInteger},
            {"added", kInteger},
            {"moved", kInteger},
            {"x", kReal},
            {"y", kReal},
            {"z", kReal},
            {"rotation", kBytes},
            {"gx", kInteger},
            {"gy", kInteger},
            {"scans", kInteger},
            {"raw_points", kInteger},
            {"voxel_points", kInteger},
            {"encoding", kInteger},
            {"bound_um", kInteger},
            {"identity", kBytes},
            {"source", kBytes},
            {"replaced", kInteger}}},
          {"cell_pose",
           {{"cell", kInteger},
            {"revision", kInteger},
            {"x", kReal},
            {"y", kReal},
            {"z", kReal},
            {"rotation", kBytes}}},
          {"cell_scans", {{"cell", kInteger}, {"T_odom_cell", kBytes}, {"scans", kBytes}}},
          {"pose_constraint",
           {{"id", kInteger},
            {"added", kInteger},
            {"removed", kInteger},
            {"from_cell", kInteger},
            {"to_cell", kInteger},
            {"kind", kInteger},
            {"origin", kInteger},
            {"T_from_to", kBytes},
            {"information", kBytes},
            {"scores", kBytes},
            {"weight", kReal},
            {"pinned", kInteger},
            {"judged", kInteger}}},
          {"document", {{"name", kText}, {"content", kText}}}};
}

/// What is not set where a staged map begins; the lattice is.
std::vector<Column> map_columns() {
  return {{"created", kInteger},       {"revision", kInteger},     {"next_constraint", kInteger},
          {"cells", kInteger},         {"planes", kInteger},       {"constraints", kInteger},
          {"encoded_bytes", kInteger}, {"stored_bytes", kInteger}, {"scans", kInteger},
          {"raw_points", kInteger},    {"voxel_points", kInteger}, {"next_cell", kInteger},
          {"oldest", kInteger},        {"latitude_deg", kReal},    {"longitude_deg", kReal},
          {"height_m", kReal},         {"R_enu_map", kBytes},      {"encoding", kInteger},
          {"bound_um", kInteger}};
}

const SqlStore& sql_store(const Store& store) {
  if (const auto* sql = dynamic_cast<const SqlStore*>(&store)) return *sql;
  throw Error(ErrorCode::kUnsupported, "a map can only be copied between SQL databases");
}

std::string list(const std::vector<Column>& columns, const char* before, const char* after) {
  std::string text;
  for (const Column& column : columns) {
    text += (text.empty() ? "" : ", ") + std::string(before) + column.name + after;
  }
  return text;
}

/// One map on its way.
class Copy {
 public:
  Copy(SqlConnection& source, const Blobs& blobs, std::int64_t from_key, const SqlStore& target,
       std::int64_t to_key, const std::stop_token& stop)
      : source_(source),
        blobs_(blobs),
        from_key_(from_key),
        target_(target),
        to_key_(to_key),
        stop_(stop) {}

  /// `each(rows written)` after every transaction.
  void rows(const Table& table, const std::function<void(std::uint64_t)>& each) {
    const bool is_cells = std::string_view(table.name) == "cell";
    // Others wait for a transaction to end, and objects are put in it.
    const std::size_t at_once = !is_cells ? 2000 : target_.blobs().are_objects() ? 8 : 32;
    Query row(source_,
              "SELECT " + list(table.columns, "", "") + " FROM " + table.name + " WHERE map = ?",
              from_key_);
    std::uint64_t done = 0;
    for (bool more = row.next(); more; each(done)) {
      if (stop_.stop_requested()) throw Error(ErrorCode::kCancelled, "the copy was cancelled");
      target_.change_tables([&](SqlConnection& target) {
        for (std::size_t i = 0; more && i < at_once; ++i, ++done, more = row.next()) {
          if (is_cells) blob(target, {row.bytes(0).begin(), row.bytes(0).end()});
          insert(target, table, row);
        }
      });
    }
  }

  void map_row() {
    const std::vector<Column> columns = map_columns();
    Query row(source_, "SELECT " + list(columns, "", "") + " FROM map WHERE id = ?", from_key_);
    row.next();
    target_.change_tables([&](SqlConnection& target) {
      Query update(target, "UPDATE map SET " + list(columns, "", " = ?") + " WHERE id = ?");
      bind(update, columns, row);
      update.bind(to_key_);
      update.run();
    });
  }

 private:
  static void bind(Query& query, const std::vector<Column>& columns, const Query& row) {
    for (std::size_t i = 0; i < columns.size(); ++i) {
      query.bind_column(row, static_cast<int>(i), columns[i].type);
    }
  }

  void insert(SqlConnection& target, const Table& table, const Query& row) {
    std::string values = "?";
    for (std::size_t i = 0; i < table.columns.size(); ++i) values += ", ?";
    Query insert(target, std::string("INSERT INTO ") + table.name + " (map, " +
                             list(table.columns, "", "") + ") VALUES (" + values + ")");
    insert.bind(to_key_);
    bind(insert, table.columns, row);
    insert.run();
  }

  void blob(SqlConnection& target, const Bytes& hash) {
    {
      Query there(target, "SELECT 1 FROM blob WHERE hash = ?", hash);
      if (there.next()) return;
    }
    std::uint64_t encoded_bytes = 0;
    {
      Query row(source_, "SELECT encoded_bytes FROM blob WHERE hash = ?", hash);
      if (row.next()) encoded_bytes = row.unsigned64(0);
    }
    const ContentHash content = hash_from(hash);
    const BlobRow row = read_blob_row(source_, content);
    const auto frame = blobs_.frame_of(content, row);
    const Blobs& to = target_.blobs();
    to.put({frame.get()});
    Query insert(target,
                 "INSERT INTO blob (hash, encoded_bytes, checksum, frame, frame_bytes) "
                 "VALUES (?, ?, ?, ?, ?)",
                 hash, encoded_bytes, to_bytes(row.checksum), to.are_objects() ? Bytes() : *frame,
                 to.are_objects() ? std::optional<std::uint64_t>(frame->size()) : std::nullopt);
    insert.run();
  }

  SqlConnection& source_;
  const Blobs& blobs_;
  const std::int64_t from_key_;
  const SqlStore& target_;
  const std::int64_t to_key_;
  const std::stop_token& stop_;
};

/// By id: the hash of the bytes that are kept.
std::vector<std::pair<std::uint32_t, ContentHash>> contents(SqlConnection& connection,
                                                            std::int64_t key) {
  std::vector<std::pair<std::uint32_t, ContentHash>> all;
  Query rows(connection, "SELECT id, hash FROM cell WHERE map = ? ORDER BY id", key);
  while (rows.next()) all.emplace_back(rows.unsigned32(0), hash_from(rows.bytes(1)));
  return all;
}

/// Every CELL of the source is in the copy and its bytes, read back, have the source's checksum.
void compare(SqlConnection& source, std::int64_t from_key, const SqlStore& to,
             std::int64_t to_key) {
  const auto expected = contents(source, from_key);
  to.read_tables([&](SqlConnection& target) {
    if (contents(target, to_key) != expected) {
      throw Error(ErrorCode::kCorruptData, "the copy has other CELLs than its source");
    }
    for (const auto& [id, hash] : expected) to.blobs().frame_of(hash, read_blob_row(target, hash));
  });
}

}  // namespace

CopiedMap copy_map(const Store& from, Store& to, const std::string& map,
                   const std::stop_token& stop,
                   const std::function<void(std::uint64_t, std::uint64_t)>& progress) {
  const SqlStore& source = sql_store(from);
  const SqlStore& target = sql_store(to);
  CopiedMap copied;
  source.read_tables([&](SqlConnection& connection) {
    const MapRow row = read_map_row(connection, map);
    StagedMap staged(to, row.info.lattice, map);
    std::int64_t to_key = 0;
    target.read_tables([&](SqlConnection& c) { to_key = read_map_row(c, staged.name()).key; });
    Copy copy(connection, source.blobs(), row.key, target, to_key, stop);
    for (const Table& table : tables()) {
      copy.rows(table, [&](std::uint64_t done) {
        if (progress && std::string_view(table.name) == "cell") progress(done, row.info.cells);
      });
    }
    copy.map_row();
    compare(connection, row.key, target, to_key);
    staged.publish();
    copied = {row.info.cells, row.info.stored_bytes};
  });
  return copied;
}

}  // namespace cellmap
