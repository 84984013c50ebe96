#include <gmock/gmock.h>

#include <atomic>
#include <latch>
#include <thread>

#include "cellmap/store/blob_cache.hpp"
#include "cellmap/store/group_commit.hpp"
#include "cellmap/store/sql_schema.hpp"
#include "cellmap/store/store_file.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::test {
namespace {

std::shared_ptr<const Bytes> blob_of(std::size_t size) {
  return std::make_shared<const Bytes>(size);
}

ContentHash hash_number(std::uint8_t number) {
  ContentHash hash;
  hash.bytes[0] = number;
  return hash;
}

TEST(BlobCache, DropsTheLongestUnusedOverItsCapacity) {
  BlobCache cache(100);
  for (std::uint8_t k = 0; k < 4; ++k) cache.insert(hash_number(k), blob_of(25));
  EXPECT_NE(cache.find(hash_number(0)), nullptr);  // used again, so 1 is the oldest now
  cache.insert(hash_number(4), blob_of(10));
  EXPECT_NE(cache.find(hash_number(0)), nullptr);
  EXPECT_EQ(cache.find(hash_number(1)), nullptr);
  EXPECT_NE(cache.find(hash_number(4)), nullptr);
  EXPECT_EQ(cache.bytes(), 85u);
}

TEST(BlobCache, CountsABlobOnceAndLeavesOutGiants) {
  BlobCache cache(100);
  cache.insert(hash_number(1), blob_of(20));
  cache.insert(hash_number(1), blob_of(20));
  cache.insert(hash_number(2), blob_of(26));
  EXPECT_EQ(cache.bytes(), 20u);
  EXPECT_EQ(cache.find(hash_number(2)), nullptr);
}

TEST(BlobCache, WithoutCapacityKeepsNothing) {
  BlobCache cache(0);
  cache.insert(hash_number(1), blob_of(1));
  EXPECT_EQ(cache.find(hash_number(1)), nullptr);
}

using Batch = std::vector<GroupCommit::Write*>;

void carry_out(const Batch& batch) {
  for (GroupCommit::Write* const write : batch) {
    try {
      write->work();
    } catch (...) {
      write->failure = std::current_exception();
    }
  }
}

TEST(GroupCommit, CarriesOutEveryWriteOnceAndOneAtATime) {
  std::size_t largest = 0, total = 0, counter = 0;  // not atomic: batches must not overlap
  GroupCommit commits(
      [&](const Batch& batch) {
        largest = std::max(largest, batch.size());
        total += batch.size();
        carry_out(batch);
      },
      std::chrono::milliseconds(5), 3);
  std::vector<std::thread> threads;
  std::latch start(8);
  for (int k = 0; k < 8; ++k) {
    threads.emplace_back([&] {
      start.arrive_and_wait();
      for (int i = 0; i < 200; ++i) commits.run([&] { ++counter; });
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(counter, 1600u);
  EXPECT_EQ(total, 1600u);
  EXPECT_LE(largest, 3u);
}

TEST(GroupCommit, ThoseThatWaitShareTheNextBatch) {
  std::vector<std::size_t> sizes;
  std::atomic<bool> first_runs{false}, let_go{false};
  GroupCommit commits(
      [&](const Batch& batch) {
        sizes.push_back(batch.size());
        carry_out(batch);
      },
      std::chrono::seconds(20), 100);
  std::thread first([&] {
    commits.run([&] {
      first_runs = true;
      while (!let_go) std::this_thread::yield();
    });
  });
  while (!first_runs) std::this_thread::yield();
  std::vector<std::thread> others;
  for (int k = 0; k < 5; ++k) others.emplace_back([&] { commits.run([] {}); });
  // The first batch counts who waits when it ends, and the next one waits for as many.
  while (commits.waiting() < 6) std::this_thread::yield();
  let_go = true;
  first.join();
  std::thread last([&] { commits.run([] {}); });
  for (std::thread& other : others) other.join();
  last.join();
  EXPECT_EQ(sizes.front(), 1u);
  EXPECT_EQ(sizes.size(), 2u);
}

TEST(GroupCommit, AFailureReachesItsOwnCallerOnly) {
  GroupCommit commits(carry_out, std::chrono::milliseconds(1), 10);
  EXPECT_THROW(commits.run([] { throw std::runtime_error("no"); }), std::runtime_error);
  EXPECT_NO_THROW(commits.run([] {}));
}

TEST(StoreFile, NetworkFileSystemsAreKnownByTheirNumbers) {
  EXPECT_EQ(network_file_system(0x6969), "NFS");
  EXPECT_EQ(network_file_system(0xFF534D42), "CIFS");
  // The kernel's number comes sign-extended where a long has 32 bits.
  EXPECT_EQ(network_file_system(static_cast<std::int32_t>(0xFF534D42)), "CIFS");
  EXPECT_EQ(network_file_system(0x01021997), "9P");
  EXPECT_EQ(network_file_system(0x65735546), "FUSE");
  for (const long local : {0xEF53L, 0x58465342L, 0x01021994L, 0x794C7630L, 0x9123683EL}) {
    EXPECT_FALSE(network_file_system(local)) << local;
  }
}

TEST(StoreFile, TheWriterLockIsExclusiveAndGivenBack) {
  const TempFolder folder;
  {
    const WriterLock lock(folder / "a");
    expect_error(
        ErrorCode::kUnavailable, [&] { WriterLock second(folder / "a"); }, "open for writing");
    EXPECT_NO_THROW(WriterLock(folder / "b"));
  }
  EXPECT_NO_THROW(WriterLock(folder / "a"));
}

TEST(GridKey, IsTheFloorOf64MetresAndDefinedForEveryDouble) {
  EXPECT_EQ(grid_key(0), 0);
  EXPECT_EQ(grid_key(-0.0), 0);
  EXPECT_EQ(grid_key(63.999), 0);
  EXPECT_EQ(grid_key(64), 1);
  EXPECT_EQ(grid_key(-1e-300), -1);
  EXPECT_EQ(grid_key(-64), -1);
  EXPECT_EQ(grid_key(-64.001), -2);
  EXPECT_LT(grid_key(-1e308), grid_key(-1e7));
  EXPECT_GT(grid_key(1e308), grid_key(1e7));
}

}  // namespace
}  // namespace cellmap::test
