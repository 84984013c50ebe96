#include "cellmap/store/sql_connection.hpp"

#include <limits>

namespace cellmap {
namespace {

[[noreturn]] void corrupt_value() {
  throw Error(
      ErrorCode::kCorruptData,
      "store: a value is outside its range, so the file is damaged; restore it from a backup");
}

void require_row(Query& query, const char* sql) {
  if (!query.next()) throw Error(ErrorCode::kInternal, std::string("store: no row from ") + sql);
}

}  // namespace

std::int64_t SqlConnection::integer(const char* sql) {
  Query row(*this, sql);
  require_row(row, sql);
  return row.integer(0);
}

std::string SqlConnection::text(const char* sql) {
  Query row(*this, sql);
  require_row(row, sql);
  return row.text(0);
}

SqlStatement& SqlConnection::prepared(std::string_view sql) {
  const auto found = statements_.find(sql);
  if (found != statements_.end()) return *found->second;
  const std::string text(sql);
  return *statements_.emplace(text, prepare(text)).first->second;
}

void SqlConnection::ask(const std::vector<Question>& questions) {
  for (const Question& question : questions) {
    Query query(*this, question.sql);
    question.bind(query);
    question.read(query);
  }
}

Query::Query(SqlConnection& connection, std::string_view sql)
    : statement_(connection.prepared(sql)) {}

Query::~Query() { statement_.release(); }

void Query::bind(const SqlValue& value, SqlType type) {
  switch (value.index()) {
    case 1:
      return statement_.bind(std::get<std::int64_t>(value));
    case 2:
      return statement_.bind(std::get<double>(value));
    case 3:
      return statement_.bind(std::get<std::string>(value));
    case 4:
      return statement_.bind(std::get<Bytes>(value));
    default:
      return statement_.bind_null(type);
  }
}

SqlValue Query::value(int column, SqlType type) const {
  if (is_null(column)) return {};
  switch (type) {
    case SqlType::kInteger:
      return integer(column);
    case SqlType::kReal:
      return real(column);
    case SqlType::kText:
      return text(column);
    case SqlType::kBytes:
      break;
  }
  const auto content = bytes(column);
  return Bytes(content.begin(), content.end());
}

bool Query::next() { return statement_.step(); }

std::int64_t Query::integer(int column) const { return statement_.integer(column); }

std::uint64_t Query::unsigned64(int column) const {
  const std::int64_t value = integer(column);
  if (value < 0) corrupt_value();
  return static_cast<std::uint64_t>(value);
}

std::uint32_t Query::unsigned32(int column) const {
  const std::uint64_t value = unsigned64(column);
  if (value > std::numeric_limits<std::uint32_t>::max()) corrupt_value();
  return static_cast<std::uint32_t>(value);
}

double Query::real(int column) const { return statement_.real(column); }

std::string Query::text(int column) const { return statement_.text(column); }

bool Query::is_null(int column) const { return statement_.is_null(column); }

std::span<const std::byte> Query::bytes(int column) const { return statement_.bytes(column); }

}  // namespace cellmap
