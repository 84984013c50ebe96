#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {

enum class SqlType { kInteger, kReal, kText, kBytes };

/// A value of a row that outlives it.
using SqlValue = std::variant<std::monostate, std::int64_t, double, std::string, Bytes>;

/// A transaction changed nothing because of another one that was under way at the same time; the
/// same transaction may be carried out again at once.
class TakenBack : public Error {
 public:
  explicit TakenBack(const std::string& message) : Error(ErrorCode::kUnavailable, message) {}
};

/// A prepared statement of an engine; used through `Query`.
class SqlStatement {
 public:
  virtual ~SqlStatement() = default;

  /// The next parameter, in order.
  virtual void bind(std::int64_t value) = 0;
  virtual void bind(double value) = 0;
  virtual void bind(const std::string& value) = 0;
  virtual void bind(const Bytes& value) = 0;
  virtual void bind_null(SqlType type) = 0;

  /// Executes at the first call; moves to the next row; false after the last.
  virtual bool step() = 0;
  /// Executes to the end, unless the first call of `step` has; see `Query::run`.
  virtual void run() {
    while (step()) {
    }
  }
  /// Forgets parameters and rows.
  virtual void release() noexcept = 0;

  // Of the current row.
  virtual std::int64_t integer(int column) const = 0;
  virtual double real(int column) const = 0;
  virtual std::string text(int column) const = 0;
  virtual bool is_null(int column) const = 0;
  virtual std::span<const std::byte> bytes(int column) const = 0;
};

class Query;

/// A statement with what its parameters and its rows are to be. What `read` is
/// given lives as long as the call.
struct Question {
  std::string sql;
  std::function<void(Query&)> bind, read;
};

/// A connection to a database with its prepared statements. One thread at a time.
///
/// What the engines have in common: parameters are `?`; integers have 64 bits, reals are doubles,
/// texts UTF-8 that sort by their bytes. The SQL of this room keeps to what SQLite and PostgreSQL
/// both understand.
///
/// Every member throws cellmap::Error: damaged bytes kCorruptData, a full or failing disk kIo, a
/// busy or unreachable database kUnavailable, `TakenBack` where it suffices to begin anew.
///
/// Where several processes write, transactions wait for each other in this order and no other, so
/// that none waits in a circle:
///
///  1. the table of maps: alone (`begin_write`) or with others that write to one map
///     (`begin_map_write`), from the beginning on;
///  2. the row of the one map that is written to (`lock_map_row`);
///  3. the row of the job that is written for (`require_claim`); who writes to jobs only
///     (`begin_row_write`) begins here;
///  4. contents of CELLs, which maps share, by their hashes (store/sql_contents.hpp).
///
/// What shares a transaction because it came at the same time (store/sql_writers.hpp) takes 3 and 4
/// again for each change; who waits in a circle then is taken back, and each change is carried out
/// by itself.
class SqlConnection {
 public:
  virtual ~SqlConnection() = default;

  /// Runs statements without parameters or results.
  virtual void execute(const char* sql) = 0;
  /// Begins a transaction all of whose reads see one state.
  virtual void begin_read() = 0;
  /// Begins a transaction that excludes all others that write, in this process and elsewhere: from
  /// its first answer on, or `settle`.
  virtual void begin_write() = 0;
  /// Begins a transaction that writes to one map, whose row it locks before all else
  /// (`lock_map_row`): where the engine can, it waits for nobody who writes to another one.
  virtual void begin_map_write() { begin_write(); }
  /// Begins a transaction that writes rows which it locks one by one, and nothing else: where the
  /// engine can, it waits for no other transaction but one that holds such a row.
  virtual void begin_row_write() { begin_write(); }
  /// The same for rows that may be lost with the machine: where the engine can, nothing waits for
  /// the disk or for a standby.
  virtual void begin_passing_write() { begin_row_write(); }
  /// Throws the failure of what was run and not waited for (`Query::run`).
  virtual void settle() {}
  /// False once a transaction was committed or rolled back, also by the engine after an error.
  virtual bool in_transaction() const = 0;

  // Words in which engines differ, for the end of a SELECT: its rows are nobody else's until the
  // transaction ends; with the second one, rows that somebody else has locked are left out.
  virtual std::string lock_rows() const { return ""; }
  virtual std::string lock_free_rows() const { return ""; }
  /// Nobody removes the rows until the transaction ends; any number may keep the same ones.
  virtual std::string keep_rows() const { return ""; }
  /// The database's clock at this moment: Unix time in nanoseconds, as an expression.
  virtual std::string now_ns() const = 0;

  /// First column of the first row of a statement.
  std::int64_t integer(const char* sql);
  std::string text(const char* sql);

 protected:
  virtual std::unique_ptr<SqlStatement> prepare(const std::string& sql) = 0;
  /// Carries out each in turn, or sends them all before it reads the first answer.
  virtual void ask(const std::vector<Question>& questions);
  SqlStatement& prepared(std::string_view sql);
  /// For destructors: statements go before what they belong to.
  void forget_statements() { statements_.clear(); }

 private:
  friend class Query;
  friend class Questions;

  std::map<std::string, std::unique_ptr<SqlStatement>, std::less<>> statements_;
};

/// One execution of a prepared statement: bind in order, then step through the rows. The statement
/// is released when this object dies, so no snapshot outlives its reader. The same SQL must not be
/// executed again while a Query of it lives. Values are always bound, never written into the SQL.
class Query {
 public:
  template <typename... Values>
  Query(SqlConnection& connection, std::string_view sql, const Values&... values)
      : Query(connection, sql) {
    (bind(values), ...);
  }
  Query(SqlConnection& connection, std::string_view sql);
  ~Query();
  Query(const Query&) = delete;
  Query& operator=(const Query&) = delete;

  /// The next parameter, for those whose number is only known at run time.
  void bind(std::int64_t value) { statement_.bind(value); }
  void bind(const Bytes& value) { statement_.bind(value); }
  void bind(const SqlValue& value, SqlType type);

  /// Moves to the next row; false after the last.
  bool next();
  /// Executes to the end a statement that gives no rows. Inside a transaction an engine that is far
  /// away need not wait for it: then its failure is thrown by what comes next, COMMIT at the
  /// latest, which does not come to be. Whatever is executed later is executed after it.
  void run() { statement_.run(); }

  std::int64_t integer(int column) const;
  /// Error{kCorruptData} where the value does not fit.
  std::uint32_t unsigned32(int column) const;
  std::uint64_t unsigned64(int column) const;
  double real(int column) const;
  std::string text(int column) const;
  bool is_null(int column) const;
  /// Valid until the next row.
  std::span<const std::byte> bytes(int column) const;
  SqlValue value(int column, SqlType type) const;

 private:
  friend class Questions;

  void bind(std::uint32_t value) { statement_.bind(static_cast<std::int64_t>(value)); }
  void bind(std::uint64_t value) { statement_.bind(static_cast<std::int64_t>(value)); }
  void bind(double value) { statement_.bind(value); }
  void bind(const std::string& value) { statement_.bind(value); }
  template <typename Value>
  void bind(const std::optional<Value>& value) {
    value ? bind(*value) : statement_.bind_null(type_of(static_cast<const Value*>(nullptr)));
  }
  // Engines that check types ask for that of NULL too.
  static SqlType type_of(const std::uint64_t*) { return SqlType::kInteger; }
  static SqlType type_of(const double*) { return SqlType::kReal; }
  static SqlType type_of(const std::string*) { return SqlType::kText; }
  static SqlType type_of(const Bytes*) { return SqlType::kBytes; }

  SqlStatement& statement_;
};

/// Questions none of which depends on another's answer, asked together: however many there are, an
/// engine that is far away costs few waits. What was run before is seen by all of them.
class Questions {
 public:
  /// `read(Query&)` gets the answer, to step through. The values are copied.
  template <typename Read, typename... Values>
  void add(std::string_view sql, Read read, Values... values) {
    questions_.push_back(
        {std::string(sql), [=](Query& query) { (query.bind(values), ...); }, std::move(read)});
  }
  /// The same for any number of values.
  template <typename Read>
  void add_many(std::string_view sql, Read read, std::vector<Bytes> values) {
    questions_.push_back({std::string(sql),
                          [values = std::move(values)](Query& query) {
                            for (const Bytes& value : values) query.bind(value);
                          },
                          std::move(read)});
  }
  bool empty() const { return questions_.empty(); }
  /// Asks all and calls each `read`, in order.
  void ask(SqlConnection& connection) const { connection.ask(questions_); }

 private:
  std::vector<Question> questions_;
};

}  // namespace cellmap
