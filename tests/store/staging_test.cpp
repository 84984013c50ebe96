#include "cellmap/store/staging.hpp"

#include <gtest/gtest.h>

#include "cellmap/store/sqlite_store.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

class StagingTest : public ::testing::Test {
 protected:
  TempFolder folder_;
  std::filesystem::path file_ = folder_.path() / "store.db";
  std::unique_ptr<Store> store_ = open_sqlite_store(file_);
};

TEST_F(StagingTest, AStagedMapIsWrittenAndReadButNotListed) {
  StagedMap staged(*store_, {}, "town");
  EXPECT_TRUE(is_staged(staged.name()));
  store_->commit(staged.name(), adding({make_cell(1)}));
  EXPECT_EQ(store_->map(staged.name()).cells, 1u);
  EXPECT_TRUE(store_->maps().empty());
  expect_error(ErrorCode::kNotFound, [&] { store_->map("town"); });
}

TEST_F(StagingTest, PublishingShowsItWhole) {
  StagedMap staged(*store_, {}, "town");
  store_->commit(staged.name(), adding({make_cell(1), make_cell(2, pose_at(6, 0))}));
  const MapInfo published = staged.publish();
  EXPECT_EQ(published.name, "town");
  EXPECT_EQ(published.cells, 2u);
  EXPECT_EQ(store_->maps().size(), 1u);
  EXPECT_EQ(store_->pose_graph("town").nodes.size(), 2u);
}

TEST_F(StagingTest, WhatIsNotPublishedIsGone) {
  { const StagedMap staged(*store_, {}, "town"); }
  std::string left;
  {
    StagedMap staged(*store_, {}, "town");
    left = staged.name();
    store_->commit(left, adding({make_cell(1)}));
    // As a crash leaves it.
    std::filesystem::copy_file(file_, folder_.path() / "crashed.db");
    std::filesystem::copy_file(file_.string() + "-wal", (folder_.path() / "crashed.db-wal"));
  }
  const auto crashed = open_sqlite_store(folder_.path() / "crashed.db");
  for (Store* const store : {store_.get(), crashed.get()}) {
    expect_error(ErrorCode::kNotFound, [&] { store->map(left); });
  }
}

TEST_F(StagingTest, TwoAreMadeSideBySideAndOneGetsTheName) {
  StagedMap first(*store_, {}, "town"), second(*store_, {}, "town");
  EXPECT_NE(first.name(), second.name());
  second.publish();
  expect_error(ErrorCode::kAlreadyExists, [&] { first.publish(); });
  expect_error(ErrorCode::kAlreadyExists, [&] { StagedMap(*store_, {}, "town"); });
}

TEST_F(StagingTest, WhatGoesAlongHappensWithItOrNotAtAll) {
  store_->create_map("other", {});
  StagedMap staged(*store_, {}, "town");
  Staging::Along along{"other", adding({make_cell(1)})};
  along.update.expected_revision = 7;
  expect_error(ErrorCode::kPreconditionFailed, [&] { staged.publish(along); });
  EXPECT_EQ(store_->maps().size(), 1u);
  along.update.expected_revision = 0;
  staged.publish(along);
  EXPECT_EQ(store_->map("other").cells, 1u);
  EXPECT_EQ(store_->maps().size(), 2u);
}

}  // namespace
}  // namespace cellmap::test
