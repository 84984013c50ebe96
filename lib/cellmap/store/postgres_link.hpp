#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "cellmap/store/database_outage.hpp"

struct pg_conn;
struct pg_result;

namespace cellmap {

/// libpq's connection to a server, and what was sent over it and not answered yet (libpq's pipeline
/// mode). Statements are carried out in the order in which they were sent; after one that fails,
/// those behind it up to the next `settle` are not.
///
/// Nothing is waited for in vain: where an answer stays away for some seconds, the host is asked
/// whether it still serves, and if it does not, the connection counts as lost. Who serves and does
/// not answer has five minutes, for a COMMIT (which may wait for a standby) half of one.
class PostgresLink {
 public:
  using Result = std::unique_ptr<pg_result, void (*)(pg_result*)>;
  using Seconds = std::chrono::seconds;
  static constexpr Seconds kLongestStatement{300}, kLongestCommit{30};

  /// Statements prepared in an earlier generation of the connection, or none, are not there.
  struct Statement {
    std::string name, sql;
    int prepared_in = 0;  ///< generation
  };
  /// In libpq's binary form; a null pointer: NULL.
  struct Parameters {
    std::vector<unsigned int> types;  ///< object ids
    std::vector<const char*> values;
    std::vector<int> lengths;
  };

  /// Connects; errors as `PostgresConnection`.
  PostgresLink(const std::string& address, std::shared_ptr<DatabaseOutage> outage);

  /// Whether it is of no use any more, as far as is known without asking.
  bool is_lost() const;
  /// Another one, with nothing sent. Error{kUnavailable}.
  void connect_again();

  /// Carries out any number of statements without parameters, at once.
  void run_script(const char* sql);
  /// Sends one statement without parameters.
  void send(const char* sql, Seconds longest = kLongestStatement);
  /// Sends a statement, which must outlive its answer, and first, where needed, what it is.
  void send(Statement& statement, const Parameters& parameters);
  /// How much was sent whose failure is not known yet.
  std::size_t unanswered() const { return unanswered_; }
  /// Waits for the answers to all that was sent since the last time: their results in order,
  /// without those of preparing. Throws the first failure; what was sent behind it was not carried
  /// out.
  std::vector<Result> settle();
  /// Nobody wants to know what becomes of what was sent, nor of this statement, which is carried
  /// out even where something before it fails. Waits for nothing.
  void send_and_forget(const char* sql);

  /// As of the last answer; false where the connection is lost.
  bool is_in_transaction() const;

 private:
  struct Sent {
    enum class Kind { kStatement, kPrepare, kSync } kind = Kind::kStatement;
    Seconds longest = kLongestStatement;
    Statement* prepared = nullptr;
  };
  struct Failure {
    std::string state, message;
  };

  void configure();
  void begin_pipeline();
  void sent(int is_sent, const Sent& what);
  void send_sync();
  /// The answer to the first of what was sent; null: none came.
  Result receive();
  /// Takes the answers to all that nobody wants to know.
  void forget();
  void await_answer(Seconds longest);
  bool host_serves() const;
  [[noreturn]] void lose(const std::string& why);
  Failure failure_of(const pg_result* result) const;

  const std::shared_ptr<DatabaseOutage> outage_;
  std::unique_ptr<pg_conn, void (*)(pg_conn*)> connection_;
  std::uint64_t outages_before_ = 0;  ///< this connection was made
  bool is_lost_ = false;              ///< although libpq does not know it
  int generation_ = 1;
  std::deque<Sent> sent_;
  std::size_t forgotten_ = 0;   ///< of `sent_`, from the first on
  std::size_t unanswered_ = 0;  ///< of `sent_`, the others
};

}  // namespace cellmap
