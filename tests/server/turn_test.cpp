#include "server/api/turn.hpp"

#include <spdlog/sinks/null_sink.h>

#include <latch>
#include <stdexcept>
#include <thread>
#include <vector>

#include "server/server_fixture.hpp"
#include "support/expect_error.hpp"

namespace cellmap::server::test {
namespace {

class TurnTest : public ::testing::Test {
 protected:
  static ApiOptions one_at_a_time() {
    ApiOptions options;
    options.threads = 3;
    options.relocalisations = 1;
    options.relocalisation_wait = std::chrono::minutes(10);
    return options;
  }

  cellmap::test::TempFolder folder_;
  std::unique_ptr<Store> store_ = open_sqlite_store(folder_ / "store.db");
  Services services_{
      *store_,
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::null_sink_mt>()),
      one_at_a_time()};
};

TEST_F(TurnTest, WhoIsAloneHasAllThreads) {
  in_turn(services_, [](const Effort& effort) { EXPECT_EQ(effort.threads, 3); });
  in_turn(services_, [](const Effort& effort) { EXPECT_EQ(effort.threads, 3); });
}

TEST_F(TurnTest, WhatFailsGivesItsTurnBack) {
  for (int i = 0; i < 3; ++i) {
    EXPECT_THROW(in_turn(services_, [](const Effort&) { throw std::runtime_error("no"); }),
                 std::runtime_error);
  }
  EXPECT_EQ(services_.turns.taken, 0);
}

TEST_F(TurnTest, WhereManyWaitTheNextIsRefusedAtOnceAndTheyGetTheirTurns) {
  std::latch over(1);
  std::atomic<int> served = 0;
  std::vector<std::thread> threads;
  threads.emplace_back([&] { in_turn(services_, [&](const Effort&) { over.wait(); }); });
  while (services_.turns.taken == 0) std::this_thread::yield();
  for (int i = 0; i < 32; ++i) {
    threads.emplace_back([&] {
      in_turn(services_, [&](const Effort& effort) {
        EXPECT_EQ(effort.threads, 1);
        ++served;
      });
    });
  }
  while (services_.turns.taken < 33) std::this_thread::yield();
  cellmap::test::expect_error(ErrorCode::kUnavailable,
                              [&] { in_turn(services_, [](const Effort&) {}); });
  over.count_down();
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(served, 32);
}

}  // namespace
}  // namespace cellmap::server::test
