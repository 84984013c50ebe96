#include "cellmap/store/copy_map.hpp"

#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

#include "cellmap/store/sql_cells.hpp"
#include "cellmap/store/sql_contents.hpp"
#include "cellmap/store/sql_reads.hpp"
#include "cellmap/store/sql_store.hpp"

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

using Row = std::vector<SqlValue>;

/// The contents of some CELLs on their way.
class Contents {
 public:
  /// Reads the frames of those that the target has not, and puts them where they are objects there.
  Contents(SqlConnection& source, const Blobs& blobs, const SqlStore& target,
           const std::vector<Row>& cells)
      : source_(source), blobs_(blobs), to_(target.blobs()) {
    for (const Row& cell : cells) hashes_.insert(hash_from(std::get<Bytes>(cell.front())));
    std::map<ContentHash, std::uint64_t> there;
    target.read_tables([&](SqlConnection& c) { there = find_contents(c, hashes_); });
    load(there);
  }

  /// As rows of the target, which this transaction may name.
  void hold(SqlConnection& target) {
    const auto there = find_contents(target, hashes_);
    load(there);  // what went meanwhile
    std::map<ContentHash, NewContent> needed;
    for (const ContentHash& hash : hashes_) {
      const auto frame = frames_.find(hash);
      if (frame == frames_.end()) {
        needed[hash] = {};
      } else {
        needed[hash] = {frame->second.encoded_bytes, frame->second.bytes.get(), to_.are_objects()};
      }
    }
    hold_contents(target, needed, there, {});
  }

 private:
  struct Frame {
    std::uint64_t encoded_bytes = 0;
    std::shared_ptr<const Bytes> bytes;
  };

  void load(const std::map<ContentHash, std::uint64_t>& there) {
    std::vector<const Bytes*> to_put;
    for (const ContentHash& hash : hashes_) {
      if (there.contains(hash) || frames_.contains(hash)) continue;
      const auto known = find_contents(source_, {hash});
      Frame& frame = frames_[hash];
      if (!known.empty()) frame.encoded_bytes = known.begin()->second;
      frame.bytes = blobs_.frame_of(hash, read_blob_row(source_, hash));
      to_put.push_back(frame.bytes.get());
    }
    to_.put(to_put);
  }

  SqlConnection& source_;
  const Blobs &blobs_, &to_;
  std::set<ContentHash> hashes_;
  std::map<ContentHash, Frame> frames_;
};

/// One map on its way.
class Copy {
 public:
  Copy(SqlConnection& source, const Blobs& blobs, std::int64_t from_key, const SqlStore& target,
       std::string to, const std::stop_token& stop)
      : source_(source),
        blobs_(blobs),
        from_key_(from_key),
        target_(target),
        to_(std::move(to)),
        stop_(stop) {}

  /// `each(rows written)` after every transaction.
  void rows(const Table& table, const std::function<void(std::uint64_t)>& each) {
    const bool is_cells = std::string_view(table.name) == "cell";
    Query row(source_,
              "SELECT " + list(table.columns, "", "") + " FROM " + table.name + " WHERE map = ?",
              from_key_);
    std::uint64_t done = 0;
    for (bool more = row.next(); more; each(done)) {
      if (stop_.stop_requested()) throw Error(ErrorCode::kCancelled, "the copy was cancelled");
      std::vector<Row> some;
      for (; more && some.size() < (is_cells ? 32 : 2000); more = row.next()) {
        some.push_back(values(row, table.columns));
      }
      insert(table, some, is_cells);
      done += some.size();
    }
  }

  void map_row() {
    const std::vector<Column> columns = map_columns();
    Query row(source_, "SELECT " + list(columns, "", "") + " FROM map WHERE id = ?", from_key_);
    row.next();
    const Row from = values(row, columns);
    target_.change_map(to_, [&](SqlConnection& target, const MapRow& to) {
      Query update(target, "UPDATE map SET " + list(columns, "", " = ?") + " WHERE id = ?");
      bind(update, columns, from);
      update.bind(to.key);
      update.run();
    });
  }

 private:
  static Row values(const Query& row, const std::vector<Column>& columns) {
    Row all;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      all.push_back(row.value(static_cast<int>(i), columns[i].type));
    }
    return all;
  }

  static void bind(Query& query, const std::vector<Column>& columns, const Row& row) {
    for (std::size_t i = 0; i < columns.size(); ++i) query.bind(row[i], columns[i].type);
  }

  void insert(const Table& table, const std::vector<Row>& some, bool is_cells) {
    std::string sql = std::string("INSERT INTO ") + table.name + " (map, " +
                      list(table.columns, "", "") + ") VALUES (?";
    for (std::size_t i = 0; i < table.columns.size(); ++i) sql += ", ?";
    sql += ")";
    std::optional<Contents> contents;  // before the transaction, which others may wait for
    if (is_cells) contents.emplace(source_, blobs_, target_, some);
    target_.change_map(to_, [&](SqlConnection& target, const MapRow& to) {
      if (contents) contents->hold(target);
      for (const Row& row : some) {
        Query insert(target, sql);
        insert.bind(to.key);
        bind(insert, table.columns, row);
        insert.run();
      }
    });
  }

  SqlConnection& source_;
  const Blobs& blobs_;
  const std::int64_t from_key_;
  const SqlStore& target_;
  const std::string to_;  ///< name of the staged map
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
             const std::string& copy) {
  const auto expected = contents(source, from_key);
  to.read_tables([&](SqlConnection& target) {
    if (contents(target, read_map_row(target, copy).key) != expected) {
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
    Copy copy(connection, source.blobs(), row.key, target, staged.name(), stop);
    for (const Table& table : tables()) {
      copy.rows(table, [&](std::uint64_t done) {
        if (progress && std::string_view(table.name) == "cell") progress(done, row.info.cells);
      });
    }
    copy.map_row();
    compare(connection, row.key, target, staged.name());
    staged.publish();
    copied = {row.info.cells, row.info.stored_bytes};
  });
  return copied;
}

}  // namespace cellmap
