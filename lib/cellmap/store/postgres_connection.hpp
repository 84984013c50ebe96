#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "cellmap/store/sql_connection.hpp"

struct pg_conn;
struct pg_result;

namespace cellmap {

/// A connection to a PostgreSQL server, in the binary protocol. A statement is prepared with the
/// types of the values it is first executed with.
///
/// A connection that was lost is made anew when the next transaction begins; what was under way
/// throws Error{kUnavailable}, and where that was a COMMIT nobody knows whether it came to be:
/// repeat it, updates are idempotent.
class PostgresConnection final : public SqlConnection {
 public:
  /// Connects. `address`: a libpq URI or keywords. Error{kInvalidArgument} for one that libpq does
  /// not understand, {kUnavailable} where nobody answers or lets us in.
  explicit PostgresConnection(const std::string& address);
  ~PostgresConnection() override;

  void execute(const char* sql) override;
  void begin_read() override;
  void begin_write() override;
  void begin_row_write() override;
  bool in_transaction() const override;

  std::string lock_rows() const override { return " FOR UPDATE"; }
  std::string lock_free_rows() const override { return " FOR UPDATE SKIP LOCKED"; }
  std::string now_ns() const override;

  /// Counts how often the connection was made: what was prepared in an earlier one is gone.
  int generation() const { return generation_; }

 private:
  friend class PostgresStatement;
  using Result = std::unique_ptr<pg_result, void (*)(pg_result*)>;

  std::unique_ptr<SqlStatement> prepare(const std::string& sql) override;
  void configure();
  void begin(const char* sql);
  /// Throws unless the result is one of success.
  Result checked(pg_result* result) const;

  std::unique_ptr<pg_conn, void (*)(pg_conn*)> connection_;
  int generation_ = 0;
  int prepared_ = 0;  ///< numbers the statements
};

}  // namespace cellmap
