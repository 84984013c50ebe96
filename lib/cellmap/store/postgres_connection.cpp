#include "cellmap/store/postgres_connection.hpp"

#include <libpq-fe.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <vector>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

// Numbers of built-in types, which never change (PostgreSQL's catalogue pg_type).
constexpr Oid kByteaOid = 17, kInt8Oid = 20, kTextOid = 25, kFloat8Oid = 701;

std::string without_line_end(const char* message) {
  std::string text = message == nullptr ? "" : message;
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  for (char& c : text) c = c == '\n' ? ' ' : c;
  return text;
}

/// What a state of the SQL standard means for us (PostgreSQL manual, appendix A).
[[noreturn]] void fail(const std::string& state, const std::string& message) {
  const std::string detail = " (PostgreSQL " + (state.empty() ? "" : state + ": ") + message + ")";
  const auto is_of = [&](std::string_view of) { return state.starts_with(of); };
  if (state == "53100") {
    throw Error(ErrorCode::kDiskFull,
                "store: the database's disk is full and nothing was changed; free space" + detail);
  }
  if (state.empty() || is_of("08") || is_of("53") || is_of("57") || is_of("40") ||
      state == "55P03" || state == "25006") {
    throw Error(ErrorCode::kUnavailable,
                "store: the database cannot be reached or is busy; try again" + detail);
  }
  if (is_of("XX") || is_of("58")) {
    throw Error(ErrorCode::kCorruptData,
                "store: the database reports damage; restore it from a backup" + detail);
  }
  if (is_of("28") || is_of("42501") || is_of("3D")) {
    throw Error(ErrorCode::kIo,
                "store: the database does not let this user in, or there is none of that name; "
                "check address, name and rights" +
                    detail);
  }
  if (is_of("22021") || is_of("22P05")) {
    throw Error(ErrorCode::kInvalidArgument, "a text is no valid UTF-8 or holds a null" + detail);
  }
  throw Error(ErrorCode::kInternal, "store: unexpected database error" + detail);
}

template <typename Value>
std::string big_endian(Value value) {
  auto bits = std::bit_cast<std::array<char, sizeof(Value)>>(value);
  if constexpr (std::endian::native == std::endian::little) {
    std::reverse(bits.begin(), bits.end());
  }
  return {bits.begin(), bits.end()};
}

template <typename Value>
Value from_big_endian(const char* bytes) {
  std::array<char, sizeof(Value)> bits;
  std::memcpy(bits.data(), bytes, bits.size());
  if constexpr (std::endian::native == std::endian::little) {
    std::reverse(bits.begin(), bits.end());
  }
  return std::bit_cast<Value>(bits);
}

/// Connects within a time that somebody waits for; who names another one in the address has it.
std::unique_ptr<pg_conn, void (*)(pg_conn*)> connect(const std::string& address) {
  const std::array keywords = {"connect_timeout", "dbname", static_cast<const char*>(nullptr)};
  const std::array values = {"3", address.c_str(), static_cast<const char*>(nullptr)};
  return {PQconnectdbParams(keywords.data(), values.data(), /*expand_dbname=*/1), PQfinish};
}

/// `?` as $1, $2 and so on; none of our SQL has one in a literal.
std::string with_numbered_parameters(const std::string& sql) {
  std::string numbered;
  int count = 0;
  for (const char c : sql) {
    if (c == '?') {
      numbered += "$" + std::to_string(++count);
    } else {
      numbered += c;
    }
  }
  return numbered;
}

}  // namespace

class PostgresStatement final : public SqlStatement {
 public:
  PostgresStatement(PostgresConnection& connection, const std::string& sql)
      : connection_(connection),
        sql_(with_numbered_parameters(sql)),
        name_("cellmap_" + std::to_string(++connection.prepared_)) {}

  void bind(std::int64_t value) override { add(kInt8Oid, big_endian(value)); }
  void bind(double value) override { add(kFloat8Oid, big_endian(value)); }
  void bind(const std::string& value) override {
    if (value.find('\0') != std::string::npos) fail("22021", "a null in a text");
    add(kTextOid, value);
  }
  void bind(const Bytes& value) override {
    add(kByteaOid, std::string(reinterpret_cast<const char*>(value.data()), value.size()));
  }
  void bind_null(SqlType type) override {
    constexpr std::array kTypes = {kInt8Oid, kFloat8Oid, kTextOid, kByteaOid};
    add(kTypes[static_cast<std::size_t>(type)], std::nullopt);
  }

  bool step() override {
    if (!result_) execute();
    return ++row_ < PQntuples(result_.get());
  }

  void release() noexcept override {
    result_.reset();
    row_ = -1;
    types_.clear();
    values_.clear();
  }

  std::int64_t integer(int column) const override {
    const char* const bytes = PQgetvalue(result_.get(), row_, column);
    switch (PQgetlength(result_.get(), row_, column)) {
      case 8:
        return from_big_endian<std::int64_t>(bytes);
      case 4:
        return from_big_endian<std::int32_t>(bytes);
      default:
        throw wrong_type();
    }
  }
  double real(int column) const override {
    if (PQgetlength(result_.get(), row_, column) != 8) throw wrong_type();
    return from_big_endian<double>(PQgetvalue(result_.get(), row_, column));
  }
  std::string text(int column) const override {
    const auto content = bytes(column);
    return {reinterpret_cast<const char*>(content.data()), content.size()};
  }
  bool is_null(int column) const override { return PQgetisnull(result_.get(), row_, column) != 0; }
  std::span<const std::byte> bytes(int column) const override {
    return {reinterpret_cast<const std::byte*>(PQgetvalue(result_.get(), row_, column)),
            static_cast<std::size_t>(PQgetlength(result_.get(), row_, column))};
  }

 private:
  static Error wrong_type() {
    return Error(ErrorCode::kCorruptData, "store: a column has another type than in our schema");
  }

  void add(Oid type, std::optional<std::string> value) {
    types_.push_back(type);
    values_.push_back(std::move(value));
  }

  void execute() {
    pg_conn* const connection = connection_.connection_.get();
    const int count = static_cast<int>(values_.size());
    if (prepared_in_ != connection_.generation_) {
      connection_.answer(
          PQsendPrepare(connection, name_.c_str(), sql_.c_str(), count, types_.data()));
      prepared_in_ = connection_.generation_;
    }
    std::vector<const char*> values;
    std::vector<int> lengths;
    for (const auto& value : values_) {
      values.push_back(value ? value->data() : nullptr);
      lengths.push_back(value ? static_cast<int>(value->size()) : 0);
    }
    const std::vector<int> binary(values_.size(), 1);
    result_ = connection_.answer(PQsendQueryPrepared(
        connection, name_.c_str(), count, values.data(), lengths.data(), binary.data(), 1));
  }

  PostgresConnection& connection_;
  const std::string sql_, name_;
  int prepared_in_ = 0;  ///< generation of the connection
  std::vector<Oid> types_;
  std::vector<std::optional<std::string>> values_;
  PostgresConnection::Result result_{nullptr, PQclear};
  int row_ = -1;
};

PostgresConnection::PostgresConnection(const std::string& address,
                                       std::shared_ptr<DatabaseOutage> outage)
    : outage_(std::move(outage)),
      connection_(nullptr, PQfinish),
      outages_before_(outage_->count()),
      generation_(1) {
  if (const std::string reason = outage_->reason(); !reason.empty()) fail("", reason);
  connection_ = connect(address);
  if (!connection_) throw Error(ErrorCode::kUnavailable, "store: out of memory");
  if (PQstatus(connection_.get()) != CONNECTION_OK) {
    char* problem = nullptr;
    PQconninfoOption* const options = PQconninfoParse(address.c_str(), &problem);
    const bool is_understood = options != nullptr;
    PQconninfoFree(options);
    PQfreemem(problem);
    if (!is_understood) {
      throw Error(ErrorCode::kInvalidArgument,
                  "store: expected postgresql://[user@]host[:port][,host...]/database");
    }
    outage_->report(without_line_end(PQerrorMessage(connection_.get())));
    throw Error(ErrorCode::kUnavailable,
                "store: cannot connect to the database; check that it runs, its address, the "
                "user's name and rights (" +
                    without_line_end(PQerrorMessage(connection_.get())) + ")");
  }
  PQsetNoticeProcessor(
      connection_.get(), [](void*, const char*) {}, nullptr);
  configure();
}

PostgresConnection::~PostgresConnection() { forget_statements(); }

/// What is sent may wait for room in the socket, what comes for the database: neither for ever.
void PostgresConnection::await_answer(std::chrono::seconds longest) {
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::seconds kSlice(1), kPatience(5);
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
bool PostgresConnection::host_serves() const {
  const std::array keywords = {"host", "port", "connect_timeout",
                               static_cast<const char*>(nullptr)};
  const std::array values = {static_cast<const char*>(PQhost(connection_.get())),
                             static_cast<const char*>(PQport(connection_.get())), "2",
                             static_cast<const char*>(nullptr)};
  return PQpingParams(keywords.data(), values.data(), 0) == PQPING_OK;
}

void PostgresConnection::lose(const std::string& why) {
  is_lost_ = true;
  outage_->report(why);
  fail("", why);
}

PostgresConnection::Result PostgresConnection::answer(int is_sent, std::chrono::seconds longest) {
  pg_conn* const connection = connection_.get();
  Result last(nullptr, PQclear);
  if (is_sent != 0) {
    await_answer(longest);
    // Of several statements the last one that was carried out.
    while (pg_result* const next = PQgetResult(connection)) {
      last.reset(next);
      await_answer(longest);
    }
  }
  const ExecStatusType status = PQresultStatus(last.get());
  if (status == PGRES_COMMAND_OK || status == PGRES_TUPLES_OK) return last;
  const auto field = [&](int which) {
    const char* const text = last ? PQresultErrorField(last.get(), which) : nullptr;
    return std::string(text ? text : "");
  };
  const std::string message = field(PG_DIAG_MESSAGE_PRIMARY);
  fail(field(PG_DIAG_SQLSTATE),
       without_line_end(message.empty() ? PQerrorMessage(connection) : message.c_str()));
}

void PostgresConnection::execute(const char* sql) {
  const bool is_commit = std::string_view(sql) == "COMMIT";
  answer(PQsendQuery(connection_.get(), sql), is_commit ? kLongestCommit : kLongestStatement);
}

/// What is lost with a connection. Our statements read few rows by an index. Where the planner,
/// which knows the columns of all maps together, expects many, compiling the statement or starting
/// workers for it takes a hundred times longer than carrying it out.
void PostgresConnection::configure() {
  PQsetnonblocking(connection_.get(), 1);  // to send, which `await_answer` goes on with
  execute(
      "SET client_encoding = 'UTF8'; SET lock_timeout = '30s'; SET jit = off; SET "
      "max_parallel_workers_per_gather = 0");
}

/// Nothing is under way yet, so a connection that was lost meanwhile may be made anew.
void PostgresConnection::begin(const char* sql) {
  if (!is_lost_ && outage_->count() == outages_before_) {
    try {
      return execute(sql);
    } catch (const Error&) {
      if (PQstatus(connection_.get()) == CONNECTION_OK && !is_lost_) throw;
    }
  }
  connect_again();
  execute(sql);
}

void PostgresConnection::connect_again() {
  if (const std::string reason = outage_->reason(); !reason.empty()) fail("", reason);
  outages_before_ = outage_->count();
  PQreset(connection_.get());
  ++generation_;
  is_lost_ = PQstatus(connection_.get()) != CONNECTION_OK;
  if (is_lost_) lose(without_line_end(PQerrorMessage(connection_.get())));
  configure();
}

void PostgresConnection::begin_read() { begin("BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"); }

/// As SQLite: one transaction that writes at a time, whichever server it comes from; it does not
/// wait for readers, nor they for it.
void PostgresConnection::begin_write() {
  begin("BEGIN");
  // A writer that is cut off from the database must not hold up the others for ever.
  execute(
      "SET LOCAL idle_in_transaction_session_timeout = '10s'; "
      "LOCK TABLE map IN SHARE ROW EXCLUSIVE MODE");
}

void PostgresConnection::begin_row_write() {
  begin("BEGIN");
  execute("SET LOCAL idle_in_transaction_session_timeout = '10s'");
}

void PostgresConnection::begin_passing_write() {
  begin_row_write();
  execute("SET LOCAL synchronous_commit = off");
}

bool PostgresConnection::in_transaction() const {
  if (is_lost_) return false;
  const PGTransactionStatusType status = PQtransactionStatus(connection_.get());
  return status == PQTRANS_INTRANS || status == PQTRANS_INERROR || status == PQTRANS_ACTIVE;
}

std::string PostgresConnection::now_ns() const {
  return "CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000000000 AS BIGINT)";
}

std::unique_ptr<SqlStatement> PostgresConnection::prepare(const std::string& sql) {
  return std::make_unique<PostgresStatement>(*this, sql);
}

}  // namespace cellmap
