#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "cellmap/store/database_outage.hpp"
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
///
/// Nothing is waited for in vain: where an answer stays away for some seconds, the host is asked
/// whether it still serves, and if it does not, the connection counts as lost. Who serves and does
/// not answer has five minutes, for a COMMIT (which may wait for a standby) half of one.
class PostgresConnection final : public SqlConnection {
 public:
  /// Connects. `address`: a libpq URI or keywords. Error{kInvalidArgument} for one that libpq does
  /// not understand, {kUnavailable} where nobody answers or lets us in.
  /// `outage`: shared by the connections of one store.
  explicit PostgresConnection(const std::string& address, std::shared_ptr<DatabaseOutage> outage =
                                                              std::make_shared<DatabaseOutage>());
  ~PostgresConnection() override;

  void execute(const char* sql) override;
  void begin_read() override;
  void begin_write() override;
  void begin_row_write() override;
  void begin_passing_write() override;
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
  void connect_again();
  /// The last result of what was sent (`is_sent`: what libpq's function for it said); throws unless
  /// it is one of success, and where none comes.
  Result answer(int is_sent, std::chrono::seconds longest = kLongestStatement);
  void await_answer(std::chrono::seconds longest);
  bool host_serves() const;
  [[noreturn]] void lose(const std::string& why);

  static constexpr std::chrono::seconds kLongestStatement{300}, kLongestCommit{30};

  const std::shared_ptr<DatabaseOutage> outage_;
  std::unique_ptr<pg_conn, void (*)(pg_conn*)> connection_;
  std::uint64_t outages_before_ = 0;  ///< this connection was made
  bool is_lost_ = false;              ///< although libpq does not know it
  int generation_ = 0;
  int prepared_ = 0;  ///< numbers the statements
};

}  // namespace cellmap
