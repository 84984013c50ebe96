#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "store/store_contract.hpp"

namespace cellmap::test {
namespace {

constexpr std::size_t kCrashCellBytes = 20'000;

NewCell numbered_cell(std::uint32_t id) {
  return make_cell(id, pose_at(id, 0), "drive", kCrashCellBytes);
}

/// A child process that commits CELL after CELL and writes the id of each acknowledged one to a
/// pipe.
[[noreturn]] void commit_until_killed(const std::filesystem::path& file, std::uint32_t first,
                                      int pipe) {
  try {
    const auto store = open_sqlite_store(file);
    for (std::uint32_t id = first;; ++id) {
      MapUpdate update = adding({numbered_cell(id)});
      if (id > 0) update.add_constraints = {make_constraint(id - 1, id)};
      if (id > 0) update.poses = {{{id - 1}, pose_at(id - 1, 1)}};
      store->commit("town", update);
      if (write(pipe, &id, sizeof(id)) != sizeof(id)) _exit(1);
    }
  } catch (...) {
    _exit(1);
  }
}

/// Reads acknowledgements until `count` have come, kills the child, and reads what is left.
std::uint32_t kill_after(pid_t child, int pipe, std::uint32_t first, unsigned count,
                         unsigned extra_microseconds) {
  std::uint32_t acknowledged = first, id = 0;
  for (unsigned i = 0; read(pipe, &id, sizeof(id)) == sizeof(id); ++i) {
    acknowledged = id + 1;
    if (i + 1 == count) {
      usleep(extra_microseconds);
      kill(child, SIGKILL);
    }
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFSIGNALED(status)) << "the child ended by itself with " << status;
  return acknowledged;
}

/// What a store must hold once the CELLs [0, acknowledged) are acknowledged. At most one more may
/// be there: committed, but killed before it could say so. Returns the number there.
std::uint32_t expect_intact(const Store& store, std::uint32_t acknowledged) {
  const MapInfo map = store.map("town");
  EXPECT_GE(map.cells, acknowledged);
  EXPECT_LE(map.cells, acknowledged + 1);
  EXPECT_EQ(map.revision, map.cells);
  const PoseGraph graph = store.pose_graph("town");
  EXPECT_EQ(graph.constraints.size(), map.cells == 0 ? 0 : map.cells - 1);
  for (std::uint32_t id = 0; id < map.cells; ++id) {
    EXPECT_EQ(zstd_decompress(*store.compressed_cell("town", {id}), kCrashCellBytes),
              numbered_cell(id).encoded.bytes);
    EXPECT_EQ(graph.nodes.at({id}).translation().y(), id + 1 == map.cells ? 0 : 1);
  }
  return static_cast<std::uint32_t>(map.cells);
}

TEST(SqliteCrash, NoAcknowledgedCommitIsLostByAKill) {
  const TempFolder folder;
  const auto file = folder / "test.cellmap";
  open_sqlite_store(file)->create_map("town", {});
  std::mt19937 random(7);
  std::uint32_t there = 0;
  for (int round = 0; round < 20; ++round) {
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      close(ends[0]);
      commit_until_killed(file, there, ends[1]);
    }
    close(ends[1]);
    const std::uint32_t acknowledged =
        kill_after(child, ends[0], there, 1 + random() % 8, random() % 3000);
    close(ends[0]);
    there = expect_intact(*open_sqlite_store(file), acknowledged);
  }
  EXPECT_GE(there, 20u);
}

/// In a child whose files must not grow: a commit that does not fit is an I/O error that names the
/// cure, changes nothing, and once there is room again the same commit works.
[[noreturn]] void fill_the_disk(const std::filesystem::path& file) {
  std::signal(SIGXFSZ, SIG_IGN);
  const auto store = open_sqlite_store(file);
  store->create_map("town", {});
  rlimit limit{2u << 20, RLIM_INFINITY};
  setrlimit(RLIMIT_FSIZE, &limit);
  std::uint32_t id = 0;
  try {
    for (; id < 1000; ++id) store->commit("town", adding({numbered_cell(id)}));
    _exit(2);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kIo) _exit(3);
    if (std::string(error.what()).find("free space") == std::string::npos) _exit(4);
  }
  if (store->map("town").cells != id) _exit(5);
  limit.rlim_cur = RLIM_INFINITY;
  setrlimit(RLIMIT_FSIZE, &limit);
  store->commit("town", adding({numbered_cell(id)}));
  _exit(store->map("town").cells == id + 1 ? 0 : 6);
}

TEST(SqliteCrash, AFullDiskIsAnErrorThatPasses) {
  const TempFolder folder;
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    try {
      fill_the_disk(folder / "test.cellmap");
    } catch (...) {
      _exit(7);
    }
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

}  // namespace
}  // namespace cellmap::test
