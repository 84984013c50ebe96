#include <thread>

#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

constexpr std::chrono::seconds kLong(30);  // only a failing test waits so long

TEST_P(StoreContract, TheVersionOfAMapIsItsCreationAndRevision) {
  const MapInfo made = store_->create_map("town", {});
  EXPECT_EQ(store_->version("town"), (MapVersion{made.created, 0}));
  store_->commit("town", adding({make_cell(1)}));
  EXPECT_EQ(store_->version("town"), (MapVersion{made.created, 1}));
  expect_error(
      ErrorCode::kNotFound, [&] { store_->version("village"); }, "village");
}

/// An engine that is asked for the changes of other servers may wake twice for one.
TEST_P(StoreContract, WhoWaitsForAChangeIsWokenOnceItCanBeSeen) {
  store_->create_map("town", {});
  CommitSignal& committed = store_->committed();
  for (Revision revision = 1; revision <= 20; ++revision) {
    auto seen = committed.count();
    ASSERT_EQ(store_->version("town").revision, revision - 1);
    std::thread writer(
        [&] { store_->commit("town", adding({make_cell(static_cast<std::uint32_t>(revision))})); });
    while (store_->version("town").revision < revision) {
      const auto before = seen;
      seen = committed.wait(before, kLong);
      if (seen == before) break;
    }
    EXPECT_EQ(store_->version("town").revision, revision);
    writer.join();
  }
}

TEST_P(StoreContract, MakingAndDeletingAMapWakeToo) {
  CommitSignal& committed = store_->committed();
  auto seen = committed.count();
  store_->create_map("town", {});
  EXPECT_NE(committed.count(), seen);
  seen = committed.count();
  store_->delete_map("town");
  EXPECT_NE(committed.count(), seen);
}

TEST_P(StoreContract, AChangeThatFailsOrIsReadinessWakesNobody) {
  store_->create_map("town", {});
  const auto seen = store_->committed().count();
  expect_error(
      ErrorCode::kNotFound, [&] { store_->commit("village", adding({make_cell(1)})); }, "village");
  store_->check_ready();
  EXPECT_EQ(store_->committed().wait(seen, std::chrono::milliseconds(1)), seen);
}

}  // namespace
}  // namespace cellmap::test
