#include "cellmap/store/store_place.hpp"

#include <string_view>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::string_view kSqlite = "sqlite:";

}  // namespace

bool is_postgres_address(const std::string& place) {
  return place.starts_with("postgresql://") || place.starts_with("postgres://");
}

std::optional<std::filesystem::path> store_file(const std::string& place) {
  if (is_postgres_address(place)) return std::nullopt;
  if (place.starts_with(kSqlite)) return place.substr(kSqlite.size());
  // A file may be named "a://b", but who writes that means an address.
  if (place.find("://") != std::string::npos) {
    throw Error(ErrorCode::kInvalidArgument,
                "store: expected the name of a file or postgresql://[user@]host/database, found '" +
                    place.substr(0, place.find("://")) + "://...'");
  }
  return place;
}

}  // namespace cellmap
