#include <algorithm>
#include <atomic>
#include <mutex>
#include <thread>

#include "store/shared_contents.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

/// Runs `body(k)` in `count` threads at the same time.
void in_threads(int count, const std::function<void(int)>& body) {
  std::vector<std::thread> threads;
  for (int k = 0; k < count; ++k) threads.emplace_back(body, k);
  for (std::thread& thread : threads) thread.join();
}

TEST_P(StoreContract, WritersAtTheSameTimeGetRevisionsWithoutGaps) {
  constexpr int kThreads = 6, kCommits = 25;
  store_->create_map("town", {});
  std::mutex mutex;
  std::vector<Revision> revisions;
  in_threads(kThreads, [&](int thread) {
    for (int i = 0; i < kCommits; ++i) {
      const auto id = static_cast<std::uint32_t>(thread * kCommits + i);
      const Revision revision = store_->commit("town", adding({make_cell(id)})).revision;
      EXPECT_EQ(store_->cell("town", {id}).added, revision);
      const std::lock_guard lock(mutex);
      revisions.push_back(revision);
    }
  });
  std::sort(revisions.begin(), revisions.end());
  ASSERT_EQ(revisions.size(), static_cast<std::size_t>(kThreads * kCommits));
  for (std::size_t i = 0; i < revisions.size(); ++i) EXPECT_EQ(revisions[i], i + 1);
}

TEST_P(StoreContract, AWriterThatFailsDoesNotDisturbTheOthers) {
  constexpr int kThreads = 6, kCommits = 20;
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1'000'000, Pose::Identity(), "taken")}));
  in_threads(kThreads, [&](int thread) {
    for (int i = 0; i < kCommits; ++i) {
      const auto id = static_cast<std::uint32_t>(thread * kCommits + i);
      MapUpdate update = adding({make_cell(id)});
      if (thread % 2 == 0) {
        EXPECT_NO_THROW(store_->commit("town", update));
      } else {
        update.cells.push_back(make_cell(1'000'000));  // other content under a taken id
        expect_error(
            ErrorCode::kConflict, [&] { store_->commit("town", update); }, "CELL 1000000");
      }
    }
  });
  const MapInfo map = store_->map("town");
  EXPECT_EQ(map.cells, 1u + kThreads / 2 * kCommits);
  EXPECT_EQ(map.revision, 1u + kThreads / 2 * kCommits);
}

TEST_P(StoreContract, OfWritersThatExpectTheSameRevisionOneWins) {
  store_->create_map("town", {});
  std::atomic<int> won{0}, lost{0};
  in_threads(8, [&](int thread) {
    MapUpdate update = adding({make_cell(static_cast<std::uint32_t>(thread))});
    update.expected_revision = 0;
    try {
      store_->commit("town", update);
      ++won;
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::kPreconditionFailed);
      ++lost;
    }
  });
  EXPECT_EQ(won, 1);
  EXPECT_EQ(lost, 7);
}

TEST_P(StoreContract, ReadersSeeOneRevisionWhileWritersWrite) {
  constexpr std::uint32_t kCells = 40;
  store_->create_map("town", {});
  std::vector<NewCell> cells;
  for (std::uint32_t id = 0; id < kCells; ++id) cells.push_back(make_cell(id, pose_at(0, 1)));
  store_->commit("town", adding(cells));

  // Every update puts all CELLs at the same x, so a mixture of revisions would show two.
  std::atomic<bool> done{false};
  std::thread writer([&] {
    for (int step = 1; step <= 60; ++step) {
      std::map<CellId, Pose> poses;
      for (std::uint32_t id = 0; id < kCells; ++id) poses[{id}] = pose_at(64.0 * step, 1);
      store_->commit("town", moving(poses));
    }
    done = true;
  });
  in_threads(4, [&](int thread) {
    do {
      if (thread % 2 == 0) {
        const PoseGraph graph = store_->pose_graph("town");
        const double x = 64.0 * static_cast<double>(graph.revision - 1);
        ASSERT_EQ(graph.nodes.size(), kCells);
        for (const auto& [id, pose] : graph.nodes) ASSERT_EQ(pose.translation().x(), x);
      } else {
        CellQuery query;
        query.near = Eigen::Vector3d(0, 0, 0);
        query.radius_m = 1e6;
        const CellPage page = store_->cells("town", query);
        ASSERT_EQ(page.cells.size(), kCells);
        for (const CellRecord& cell : page.cells) ASSERT_EQ(cell.moved, page.revision);
        ASSERT_EQ(store_->changes("town", 0).added.size(), kCells);
      }
    } while (!done);
  });
  writer.join();
}

TEST_P(StoreContract, MapsThatTakeAndLeaveTheSameContentsAtRandomLoseNone) {
  race_for_contents({store_.get(), store_.get(), store_.get(), store_.get()}, 12);
}

TEST_P(StoreContract, AMapThatIsDeletedWhileOthersWriteToItIsNotFoundByThem) {
  store_->create_map("town", {});
  std::atomic<bool> deleted{false};
  in_threads(4, [&](int thread) {
    if (thread == 0) {
      while (store_->map("town").revision < 20) std::this_thread::yield();
      store_->delete_map("town");
      deleted = true;
      return;
    }
    for (std::uint32_t i = 0; i < 10'000; ++i) {
      try {
        const auto id = static_cast<std::uint32_t>(thread) * 10'000 + i;
        store_->commit("town", adding({make_cell(id)}));
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::kNotFound) << error.what();
        return;
      }
    }
    ADD_FAILURE() << "the map was never gone";
  });
  EXPECT_TRUE(deleted);
  EXPECT_TRUE(store_->maps().empty());
}

}  // namespace
}  // namespace cellmap::test
