#include "cellmap/store/postgres_connection.hpp"

#include <libpq-fe.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <optional>
#include <string_view>
#include <utility>

#include "cellmap/core/error.hpp"
#include "cellmap/store/postgres_error.hpp"

namespace cellmap {
namespace {

// Numbers of built-in types, which never change (PostgreSQL's catalogue pg_type).
constexpr Oid kByteaOid = 17, kInt8Oid = 20, kTextOid = 25, kFloat8Oid = 701;

/// So much may be on its way before somebody looks whether it went well.
constexpr std::size_t kMostUnanswered = 256, kMostUnansweredBytes = 4u << 20;
/// So many questions are on their way at once.
constexpr std::size_t kAskedAtOnce = 256;

constexpr const char* kBeginRead = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY";
// A statement sees what was committed while it waited for a row.
constexpr const char* kBeginWrite = "BEGIN ISOLATION LEVEL READ COMMITTED";
// A writer that is cut off from the database must not hold up the others for ever.
constexpr const char* kNotIdleForLong = "SET LOCAL idle_in_transaction_session_timeout = '10s'";

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
        statement_{"cellmap_" + std::to_string(++connection.prepared_),
                   with_numbered_parameters(sql)} {}

  void bind(std::int64_t value) override { add(kInt8Oid, big_endian(value)); }
  void bind(double value) override { add(kFloat8Oid, big_endian(value)); }
  void bind(const std::string& value) override {
    if (value.find('\0') != std::string::npos) {
      throw_postgres_error("22021", "a null in a text");
    }
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
    if (!result_) result_ = connection_.answer(statement_, parameters());
    return ++row_ < PQntuples(result_.get());
  }

  void run() override {
    if (result_) return;
    std::size_t bytes = 0;
    for (const auto& value : values_) bytes += value ? value->size() : 0;
    connection_.run(statement_, parameters(), bytes);
  }

  /// Executes without waiting; what comes of it is to be given to `accept`.
  void send() { connection_.link_.send(statement_, parameters()); }
  void accept(PostgresConnection::Result result) { result_ = std::move(result); }

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

  PostgresLink::Parameters parameters() const {
    PostgresLink::Parameters all{types_, {}, {}};
    for (const auto& value : values_) {
      all.values.push_back(value ? value->data() : nullptr);
      all.lengths.push_back(value ? static_cast<int>(value->size()) : 0);
    }
    return all;
  }

  PostgresConnection& connection_;
  PostgresLink::Statement statement_;
  std::vector<Oid> types_;
  std::vector<std::optional<std::string>> values_;
  PostgresConnection::Result result_{nullptr, PQclear};
  int row_ = -1;
};

PostgresConnection::PostgresConnection(const std::string& address,
                                       std::shared_ptr<DatabaseOutage> outage, bool one_by_one)
    : link_(address, std::move(outage)), one_by_one_(one_by_one) {}

PostgresConnection::~PostgresConnection() { forget_statements(); }

void PostgresConnection::execute(const char* sql) {
  const std::string_view words(sql);
  if (begin_.empty()) return link_.run_script(sql);
  if (words == "COMMIT") return commit(sql);
  if (words == "ROLLBACK") {
    const bool holds_locks =
        begin_.front() != std::string_view(kBeginRead);  // which others may not find afterwards
    begin_.clear();
    link_.send_and_forget(sql);
    if (holds_locks || one_by_one_) link_.settle();
    return;
  }
  settle_begin();
  if (words.starts_with("ROLLBACK TO")) {
    // Behind a failure nobody has heard of it would not be carried out.
    try {
      settle();
    } catch (const Error&) {
      if (!in_transaction()) throw;
    }
  }
  link_.send(sql);
  if (one_by_one_) settle();
}

/// A transaction in which a statement failed answers COMMIT with having been rolled back.
void PostgresConnection::commit(const char* sql) {
  settle_begin();
  link_.send(sql, PostgresLink::kLongestCommit);
  const std::vector<Result> results = link_.settle();
  unanswered_bytes_ = 0;
  begin_.clear();
  if (std::string_view(PQcmdStatus(results.back().get())) != "COMMIT") {
    throw_postgres_error("25P02", "the transaction was rolled back");
  }
}

/// Nothing is under way yet, so a connection that was lost meanwhile may be made anew.
void PostgresConnection::begin(std::vector<const char*> statements) {
  begin_ = std::move(statements);
  is_fresh_ = true;
  unanswered_bytes_ = 0;
  if (link_.is_lost()) return begin_again_unless_alive();
  try {
    send_begin();
    if (one_by_one_) settle_begin();
  } catch (const Error&) {
    begin_again_unless_alive();
  }
}

void PostgresConnection::send_begin() {
  for (const char* const statement : begin_) {
    link_.send(statement);
    if (one_by_one_) link_.settle();
  }
}

/// In a handler of the error that told of the loss.
void PostgresConnection::begin_again_unless_alive() {
  if (!link_.is_lost()) throw;
  try {
    link_.connect_again();
    send_begin();
  } catch (const Error&) {
    begin_.clear();
    throw;
  }
}

void PostgresConnection::settle_begin() {
  if (!is_fresh_) return;
  try {
    link_.settle();
  } catch (const Error&) {
    begin_again_unless_alive();
    link_.settle();
  }
  is_fresh_ = false;
}

void PostgresConnection::settle() {
  settle_begin();
  unanswered_bytes_ = 0;
  link_.settle();
}

PostgresConnection::Result PostgresConnection::answer(PostgresLink::Statement& statement,
                                                      const PostgresLink::Parameters& parameters) {
  unanswered_bytes_ = 0;
  if (is_fresh_ && !begin_.empty()) {
    try {
      link_.send(statement, parameters);
      auto results = link_.settle();
      is_fresh_ = false;
      return std::move(results.back());
    } catch (const Error&) {
      begin_again_unless_alive();
    }
    is_fresh_ = false;
  }
  link_.send(statement, parameters);
  return std::move(link_.settle().back());
}

void PostgresConnection::run(PostgresLink::Statement& statement,
                             const PostgresLink::Parameters& parameters, std::size_t bytes) {
  const bool is_ours = !begin_.empty();
  if (is_ours) settle_begin();
  link_.send(statement, parameters);
  unanswered_bytes_ += bytes;
  if (!is_ours || one_by_one_ || link_.unanswered() >= kMostUnanswered ||
      unanswered_bytes_ >= kMostUnansweredBytes) {
    settle();
  }
}

void PostgresConnection::ask(const std::vector<Question>& questions) {
  if (one_by_one_) return SqlConnection::ask(questions);
  if (!begin_.empty()) settle_begin();
  const auto statement = [&](const Question& question) -> PostgresStatement& {
    return static_cast<PostgresStatement&>(prepared(question.sql));
  };
  for (std::size_t begin = 0; begin < questions.size(); begin += kAskedAtOnce) {
    const std::size_t count = std::min(kAskedAtOnce, questions.size() - begin);
    for (std::size_t i = 0; i < count; ++i) {
      const Question& question = questions[begin + i];
      Query query(*this, question.sql);
      question.bind(query);
      statement(question).send();
    }
    std::vector<Result> results = link_.settle();
    const std::size_t first = results.size() - count;  // the others were run before
    for (std::size_t i = 0; i < count; ++i) {
      const Question& question = questions[begin + i];
      Query query(*this, question.sql);
      statement(question).accept(std::move(results[first + i]));
      question.read(query);
    }
  }
}

void PostgresConnection::begin_read() { begin({kBeginRead}); }

/// As SQLite: nobody else writes, whichever server it comes from. No writer waits for readers, nor
/// they for it.
void PostgresConnection::begin_write() {
  begin({kBeginWrite, kNotIdleForLong, "LOCK TABLE map IN SHARE ROW EXCLUSIVE MODE"});
}

/// The mode that the table's changes take anyway: taken first, so that whoever waits for the other
/// mode waits before this transaction has anything, or after it has ended.
void PostgresConnection::begin_map_write() {
  begin({kBeginWrite, kNotIdleForLong, "LOCK TABLE map IN ROW EXCLUSIVE MODE"});
}

void PostgresConnection::begin_row_write() { begin({kBeginWrite, kNotIdleForLong}); }

void PostgresConnection::begin_passing_write() {
  begin({kBeginWrite, kNotIdleForLong, "SET LOCAL synchronous_commit = off"});
}

bool PostgresConnection::in_transaction() const {
  if (begin_.empty()) return link_.unanswered() == 0 && link_.is_in_transaction();
  return is_fresh_ || link_.is_in_transaction();
}

std::string PostgresConnection::now_ns() const {
  return "CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000000000 AS BIGINT)";
}

std::unique_ptr<SqlStatement> PostgresConnection::prepare(const std::string& sql) {
  return std::make_unique<PostgresStatement>(*this, sql);
}

}  // namespace cellmap
