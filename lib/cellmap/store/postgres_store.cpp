#include "cellmap/store/postgres_store.hpp"

#include <chrono>
#include <condition_variable>
#include <stop_token>
#include <thread>

#include "cellmap/core/error.hpp"
#include "cellmap/store/postgres_connection.hpp"
#include "cellmap/store/postgres_schema.hpp"
#include "cellmap/store/sql_store.hpp"

namespace cellmap {
namespace {

/// A restore of the largest map takes less.
constexpr std::chrono::hours kStagingLimit(24);
constexpr std::chrono::milliseconds kLookForCommits(500);

class PostgresStore final : public SqlStore {
 public:
  explicit PostgresStore(SqlEngine engine)
      : SqlStore(std::move(engine)), look_for_commits_([this](const std::stop_token& stop) {
          std::mutex mutex;
          std::condition_variable_any stopped;
          std::unique_lock lock(mutex);
          while (!stopped.wait_for(lock, stop, kLookForCommits,
                                   [&] { return stop.stop_requested(); })) {
            committed().notify();
          }
        }) {}

 private:
  std::jthread look_for_commits_;  ///< those of other processes
};

}  // namespace

void PostgresStoreOptions::validate() const {
  if (max_readers < 1 || max_writers < 1) {
    throw Error(ErrorCode::kInvalidArgument,
                "store options: expected at least one reader and one writer");
  }
  if (objects) objects->validate();
}

std::unique_ptr<Store> open_postgres_store(const std::string& address,
                                           const PostgresStoreOptions& options) {
  options.validate();
  const auto connect = [address, one_by_one = options.one_by_one,
                        outage = std::make_shared<DatabaseOutage>()] {
    return std::make_unique<PostgresConnection>(address, outage, one_by_one);
  };
  auto writer = connect();
  migrate_postgres_schema(*writer);
  return std::make_unique<PostgresStore>(SqlEngine{.name = "in PostgreSQL",
                                                   .held = nullptr,
                                                   .open_reader = connect,
                                                   .max_readers = options.max_readers,
                                                   .writer = std::move(writer),
                                                   .open_writer = connect,
                                                   .max_writers = options.max_writers,
                                                   .claimer = connect(),
                                                   .cache_bytes = options.cache_bytes,
                                                   .objects = options.objects,
                                                   .staging_limit = kStagingLimit});
}

}  // namespace cellmap
