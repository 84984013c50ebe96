#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "cellmap/store/database_outage.hpp"
#include "cellmap/store/postgres_link.hpp"
#include "cellmap/store/sql_connection.hpp"

namespace cellmap {

/// A connection to a PostgreSQL server, in the binary protocol. A statement is prepared with the
/// types of the values it is first executed with.
///
/// Inside a transaction that a member of this class began, nothing waits for an answer that gives
/// no rows: such statements are sent, and a question, or COMMIT, waits for them all.
///
/// A connection that was lost is made anew when the next transaction begins; what was under way
/// throws Error{kUnavailable}, and where that was a COMMIT nobody knows whether it came to be:
/// repeat it, updates are idempotent.
///
/// Nothing is waited for in vain (store/postgres_link.hpp).
class PostgresConnection final : public SqlConnection {
 public:
  /// Connects. `address`: a libpq URI or keywords. Error{kInvalidArgument} for one that libpq does
  /// not understand, {kUnavailable} where nobody answers or lets us in.
  /// `outage`: shared by the connections of one store.
  /// `one_by_one`: every statement waits for its answer, to measure what it costs.
  explicit PostgresConnection(
      const std::string& address,
      std::shared_ptr<DatabaseOutage> outage = std::make_shared<DatabaseOutage>(),
      bool one_by_one = false);
  ~PostgresConnection() override;

  /// Inside a transaction that a member began: one statement.
  void execute(const char* sql) override;
  void begin_read() override;
  void begin_write() override;
  void begin_map_write() override;
  void begin_row_write() override;
  void begin_passing_write() override;
  void settle() override;
  bool in_transaction() const override;

  std::string lock_rows() const override { return " FOR UPDATE"; }
  std::string lock_free_rows() const override { return " FOR UPDATE SKIP LOCKED"; }
  std::string keep_rows() const override { return " FOR KEY SHARE"; }
  std::string now_ns() const override;

 private:
  friend class PostgresStatement;
  using Result = PostgresLink::Result;

  std::unique_ptr<SqlStatement> prepare(const std::string& sql) override;
  void ask(const std::vector<Question>& questions) override;
  void begin(std::vector<const char*> statements);
  void send_begin();
  /// Executes and waits. Where nothing of the transaction was answered yet, a lost connection is
  /// made anew: nothing has been seen or changed.
  Result answer(PostgresLink::Statement& statement, const PostgresLink::Parameters& parameters);
  /// Executes without waiting.
  void run(PostgresLink::Statement& statement, const PostgresLink::Parameters& parameters,
           std::size_t bytes);
  /// Waits until the transaction has begun.
  void settle_begin();
  void begin_again_unless_alive();
  void commit(const char* sql);

  PostgresLink link_;
  const bool one_by_one_;
  int prepared_ = 0;                ///< numbers the statements
  std::vector<const char*> begin_;  ///< what the transaction began with; empty: none of ours
  bool is_fresh_ = false;           ///< its beginning is not answered yet
  std::size_t unanswered_bytes_ = 0;
};

}  // namespace cellmap
