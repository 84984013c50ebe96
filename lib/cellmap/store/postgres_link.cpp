#include "cellmap/store/postgres_link.hpp"

#include <libpq-fe.h>
#include <poll.h>

#include <array>
#include <optional>
#include <utility>

#include "cellmap/core/error.hpp"
#include "cellmap/store/postgres_error.hpp"

namespace cellmap {
namespace {

/// Connects within a time that somebody waits for; who names another one in the address has it.
std::unique_ptr<pg_conn, void (*)(pg_conn*)> connect(const std::string& address) {
  const std::array keywords = {"connect_timeout", "dbname", static_cast<const char*>(nullptr)};
  const std::array values = {"3", address.c_str(), static_cast<const char*>(nullptr)};
  return {PQconnectdbParams(keywords.data(), values.data(), /*expand_dbname=*/1), PQfinish};
}

bool is_understood(const std::string& address) {
  char* problem = nullptr;
  PQconninfoOption* const options = PQconninfoParse(address.c_str(), &problem);
  const bool is_one = options != nullptr;
  PQconninfoFree(options);
  PQfreemem(problem);
  return is_one;
}

bool is_success(const pg_result* result) {
  const ExecStatusType status = PQresultStatus(result);
  return status == PGRES_COMMAND_OK || status == PGRES_TUPLES_OK;
}

}  // namespace

PostgresLink::PostgresLink(const std::string& address, std::shared_ptr<DatabaseOutage> outage)
    : outage_(std::move(outage)),
      connection_(nullptr, PQfinish),
      outages_before_(outage_->count()) {
  if (const std::string reason = outage_->reason(); !reason.empty()) {
    throw_postgres_error("", reason);
  }
  connection_ = connect(address);
  if (!connection_) throw Error(ErrorCode::kUnavailable, "store: out of memory");
  if (PQstatus(connection_.get()) != CONNECTION_OK) {
    if (!is_understood(address)) {
      throw Error(ErrorCode::kInvalidArgument,
                  "store: expected postgresql://[user@]host[:port][,host...]/database");
    }
    const std::string why = without_line_end(PQerrorMessage(connection_.get()));
    outage_->report(why);
    throw Error(ErrorCode::kUnavailable,
                "store: cannot connect to the database; check that it runs, its address, the "
                "user's name and rights (" +
                    why + ")");
  }
  PQsetNoticeProcessor(
      connection_.get(), [](void*, const char*) {}, nullptr);
  configure();
}

/// What is lost with a connection. Our statements read few rows by an index. Where the planner,
/// which knows the columns of all maps together, expects many, compiling the statement or starting
/// workers for it takes a hundred times longer than carrying it out.
void PostgresLink::configure() {
  PQsetnonblocking(connection_.get(), 1);  // to send, which `await_answer` goes on with
  run_script(
      "SET client_encoding = 'UTF8'; SET lock_timeout = '30s'; SET jit = off; SET "
      "max_parallel_workers_per_gather = 0");
}

bool PostgresLink::is_lost() const {
  return is_lost_ || outage_->count() != outages_before_ ||
         PQstatus(connection_.get()) != CONNECTION_OK;
}

void PostgresLink::connect_again() {
  if (const std::string reason = outage_->reason(); !reason.empty()) {
    throw_postgres_error("", reason);
  }
  outages_before_ = outage_->count();
  sent_.clear();
  forgotten_ = unanswered_ = 0;
  PQreset(connection_.get());
  ++generation_;
  is_lost_ = PQstatus(connection_.get()) != CONNECTION_OK;
  if (is_lost_) lose(without_line_end(PQerrorMessage(connection_.get())));
  configure();
}

void PostgresLink::run_script(const char* sql) {
  pg_conn* const connection = connection_.get();
  if (PQpipelineStatus(connection) != PQ_PIPELINE_OFF) {
    settle();
    PQexitPipelineMode(connection);
  }
  Result last(nullptr, PQclear);
  if (PQsendQuery(connection, sql) != 0) {
    await_answer(kLongestStatement);
    // Of several statements the last one that was carried out.
    while (pg_result* const next = PQgetResult(connection)) {
      last.reset(next);
      await_answer(kLongestStatement);
    }
  }
  if (is_success(last.get())) return;
  const Failure failure = failure_of(last.get());
  throw_postgres_error(failure.state, failure.message);
}

void PostgresLink::begin_pipeline() {
  if (PQpipelineStatus(connection_.get()) != PQ_PIPELINE_OFF) return;
  if (PQenterPipelineMode(connection_.get()) == 0) {
    throw_postgres_error("", without_line_end(PQerrorMessage(connection_.get())));
  }
}

void PostgresLink::sent(int is_sent, const Sent& what) {
  if (is_sent == 0) {
    throw_postgres_error("", without_line_end(PQerrorMessage(connection_.get())));
  }
  sent_.push_back(what);
  ++unanswered_;
}

void PostgresLink::send(const char* sql, Seconds longest) {
  begin_pipeline();
  sent(PQsendQueryParams(connection_.get(), sql, 0, nullptr, nullptr, nullptr, nullptr, 1),
       {.longest = longest});
}

void PostgresLink::send(Statement& statement, const Parameters& parameters) {
  begin_pipeline();
  const int count = static_cast<int>(parameters.values.size());
  if (statement.prepared_in != generation_) {
    sent(PQsendPrepare(connection_.get(), statement.name.c_str(), statement.sql.c_str(), count,
                       parameters.types.data()),
         {.kind = Sent::Kind::kPrepare, .prepared = &statement});
    statement.prepared_in = generation_;
  }
  const std::vector<int> binary(parameters.values.size(), 1);
  sent(PQsendQueryPrepared(connection_.get(), statement.name.c_str(), count,
                           parameters.values.data(), parameters.lengths.data(), binary.data(), 1),
       {});
}

void PostgresLink::send_sync() {
  if (sent_.empty() || sent_.back().kind == Sent::Kind::kSync) return;
  sent(PQpipelineSync(connection_.get()), {.kind = Sent::Kind::kSync});
}

void PostgresLink::send_and_forget(const char* sql) {
  if (unanswered_ > 0) send_sync();
  send(sql);
  send_sync();
  forgotten_ += std::exchange(unanswered_, 0);
  PQflush(connection_.get());  // what is left of it goes before whatever is sent next
}

PostgresLink::Result PostgresLink::receive() {
  const Sent what = sent_.front();
  await_answer(what.longest);
  Result result(PQgetResult(connection_.get()), PQclear);
  if (what.kind != Sent::Kind::kSync) {
    while (pg_result* const more = PQgetResult(connection_.get())) PQclear(more);
  }
  if (what.kind == Sent::Kind::kPrepare && !is_success(result.get())) {
    what.prepared->prepared_in = 0;
  }
  sent_.pop_front();
  if (PQstatus(connection_.get()) != CONNECTION_OK) {
    sent_.clear();
    forgotten_ = unanswered_ = 0;
  }
  return result;
}

void PostgresLink::forget() {
  while (forgotten_ > 0) {
    --forgotten_;
    receive();
  }
}

std::vector<PostgresLink::Result> PostgresLink::settle() {
  send_sync();
  forget();
  std::vector<Result> results;
  std::optional<Failure> failure;
  while (unanswered_ > 0) {
    const Sent::Kind kind = sent_.front().kind;
    --unanswered_;
    Result result = receive();
    if (kind == Sent::Kind::kSync) continue;
    if (!is_success(result.get())) {
      if (!failure) failure = failure_of(result.get());
    } else if (kind == Sent::Kind::kStatement) {
      results.push_back(std::move(result));
    }
  }
  if (!failure && PQstatus(connection_.get()) != CONNECTION_OK) failure = failure_of(nullptr);
  if (failure) throw_postgres_error(failure->state, failure->message);
  return results;
}

PostgresLink::Failure PostgresLink::failure_of(const pg_result* result) const {
  const auto field = [&](int which) {
    const char* const text = result ? PQresultErrorField(result, which) : nullptr;
    return std::string(text ? text : "");
  };
  const std::string message = field(PG_DIAG_MESSAGE_PRIMARY);
  return {field(PG_DIAG_SQLSTATE),
          without_line_end(message.empty() ? PQerrorMessage(connection_.get()) : message.c_str())};
}

/// What is sent may wait for room in the socket, what comes for the database: neither for ever.
void PostgresLink::await_answer(Seconds longest) {
  using Clock = std::chrono::steady_clock;
  constexpr Seconds kSlice(1), kPatience(5);
  pg_conn* const connection = connection_.get();
  const auto begun = Clock::now();
  auto heard = begun;
  for (;;) {
    const int unsent = PQflush(connection);
    if (unsent < 0 || (unsent == 0 && PQisBusy(connection) == 0)) return;
    const short events = static_cast<short>(unsent > 0 ? POLLIN | POLLOUT : POLLIN);
    pollfd socket{PQsocket(connection), events, 0};
    const int ready = ::poll(&socket, 1, std::chrono::milliseconds(kSlice).count());
    if (ready > 0) {
      heard = Clock::now();
      if ((socket.revents & ~POLLOUT) != 0 && PQconsumeInput(connection) == 0) return;
      continue;
    }
    if (Clock::now() - begun > longest) lose("it did not answer in time");
    if (Clock::now() - heard < kPatience && outage_->count() == outages_before_) continue;
    if (!host_serves()) lose("it does not answer any more");
    outages_before_ = outage_->count();
    heard = Clock::now();
  }
}

/// Asks the host of this very connection, over another one.
bool PostgresLink::host_serves() const {
  const std::array keywords = {"host", "port", "connect_timeout",
                               static_cast<const char*>(nullptr)};
  const std::array values = {static_cast<const char*>(PQhost(connection_.get())),
                             static_cast<const char*>(PQport(connection_.get())), "2",
                             static_cast<const char*>(nullptr)};
  return PQpingParams(keywords.data(), values.data(), 0) == PQPING_OK;
}

void PostgresLink::lose(const std::string& why) {
  is_lost_ = true;
  sent_.clear();
  forgotten_ = unanswered_ = 0;
  outage_->report(why);
  throw_postgres_error("", why);
}

bool PostgresLink::is_in_transaction() const {
  if (is_lost_) return false;
  const PGTransactionStatusType status = PQtransactionStatus(connection_.get());
  return status == PQTRANS_INTRANS || status == PQTRANS_INERROR || status == PQTRANS_ACTIVE;
}

}  // namespace cellmap
