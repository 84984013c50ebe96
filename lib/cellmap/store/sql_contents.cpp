#include "cellmap/store/sql_contents.hpp"

#include <algorithm>
#include <utility>

#include "cellmap/store/sql_cells.hpp"

namespace cellmap {
namespace {

/// How many a statement names.
constexpr std::size_t kNamedAtOnce = 64;

std::string select_contents(const char* columns, const std::string& end) {
  std::string sql = std::string("SELECT ") + columns + " FROM blob WHERE hash IN (?";
  for (std::size_t i = 1; i < kNamedAtOnce; ++i) sql += ", ?";
  return sql + ")" + end;
}

/// Takes `kNamedAtOnce` of them, or fewer, the last one again and again.
std::vector<Bytes> next_values(const std::vector<ContentHash>& hashes, std::size_t begin) {
  std::vector<Bytes> values;
  for (std::size_t i = 0; i < kNamedAtOnce; ++i) {
    values.push_back(to_bytes(hashes[std::min(begin + i, hashes.size() - 1)]));
  }
  return values;
}

/// Locks contents that are there, in runs between those that are not.
class Holding {
 public:
  explicit Holding(SqlConnection& connection) : connection_(connection) {}

  void add(const ContentHash& hash, bool is_left) {
    if (is_left != are_left_) flush();
    are_left_ = is_left;
    run_.push_back(hash);
  }
  /// What was added is held.
  void finish() {
    flush();
    questions_.ask(connection_);
    questions_ = {};
    if (held_ < expected_) {
      throw TakenBack(
          "store: bytes that CELLs share were removed from another map meanwhile; try again");
    }
  }

 private:
  void flush() {
    const std::string lock = are_left_ ? connection_.lock_rows() : connection_.keep_rows();
    for (std::size_t i = 0; i < run_.size() && !lock.empty(); i += kNamedAtOnce) {
      if (!are_left_) expected_ += std::min(kNamedAtOnce, run_.size() - i);
      questions_.add_many(
          select_contents("hash", " ORDER BY hash" + lock),
          [this, are_left = are_left_](Query& rows) {
            while (rows.next()) held_ += are_left ? 0 : 1;
          },
          next_values(run_, i));
    }
    run_.clear();
  }

  SqlConnection& connection_;
  bool are_left_ = false;
  std::vector<ContentHash> run_;
  Questions questions_;
  std::size_t expected_ = 0, held_ = 0;  ///< of those that are to be kept
};

/// One that somebody else has written just now is held, too.
void insert_content(SqlConnection& connection, const ContentHash& hash, const NewContent& content) {
  Query(connection,
        "INSERT INTO blob (hash, encoded_bytes, checksum, frame, frame_bytes) "
        "VALUES (?, ?, ?, ?, ?) "
        "ON CONFLICT (hash) DO UPDATE SET encoded_bytes = excluded.encoded_bytes",
        to_bytes(hash), content.encoded_bytes, to_bytes(sha256(*content.frame)),
        content.is_object ? Bytes() : *content.frame,
        content.is_object ? std::optional<std::uint64_t>(content.frame->size()) : std::nullopt)
      .run();
}

}  // namespace

Bytes to_bytes(const ContentHash& hash) {
  const auto raw = std::as_bytes(std::span(hash.bytes));
  return {raw.begin(), raw.end()};
}

std::map<ContentHash, std::uint64_t> find_contents(SqlConnection& connection,
                                                   const std::set<ContentHash>& hashes) {
  std::map<ContentHash, std::uint64_t> found;
  const std::vector<ContentHash> wanted(hashes.begin(), hashes.end());
  Questions questions;
  for (std::size_t i = 0; i < wanted.size(); i += kNamedAtOnce) {
    questions.add_many(
        select_contents("hash, encoded_bytes", ""),
        [&](Query& rows) {
          while (rows.next()) found.emplace(hash_from(rows.bytes(0)), rows.unsigned64(1));
        },
        next_values(wanted, i));
  }
  questions.ask(connection);
  return found;
}

void hold_contents(SqlConnection& connection, const std::map<ContentHash, NewContent>& needed,
                   const std::map<ContentHash, std::uint64_t>& there,
                   const std::set<ContentHash>& left) {
  std::map<ContentHash, const NewContent*> in_order;  // null: it is there
  for (const auto& [hash, content] : needed) {
    in_order.emplace(hash, there.contains(hash) ? nullptr : &content);
  }
  for (const ContentHash& hash : left) in_order.emplace(hash, nullptr);
  Holding holding(connection);
  for (const auto& [hash, content] : in_order) {
    if (!content) {
      holding.add(hash, left.contains(hash));
    } else {
      holding.finish();  // those before it come first
      insert_content(connection, hash, *content);
    }
  }
  holding.finish();
}

std::set<ContentHash> kept_contents(SqlConnection& connection, std::int64_t map,
                                    const std::optional<std::string>& session) {
  std::set<ContentHash> contents;
  Query rows(connection,
             "SELECT DISTINCT hash FROM cell WHERE map = ? AND session = COALESCE(?, session)", map,
             session);
  while (rows.next()) contents.insert(hash_from(rows.bytes(0)));
  return contents;
}

void remove_unused_contents(SqlConnection& connection, const std::set<ContentHash>& contents) {
  for (const ContentHash& content : contents) {
    Query(connection,
          "DELETE FROM blob WHERE hash = ? AND NOT EXISTS (SELECT 1 FROM cell WHERE hash = ?)",
          to_bytes(content), to_bytes(content))
        .run();
  }
}

}  // namespace cellmap
