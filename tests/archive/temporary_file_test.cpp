#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/inotify.h>
#include <unistd.h>

#include "cellmap/archive/byte_source.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

TEST(TemporaryFile, NeverHasANameThatAKillCouldLeaveBehind) {
  const test::TempFolder folder;
  const int probe = ::open(folder.path().c_str(), O_TMPFILE | O_RDWR, 0600);
  if (probe < 0) GTEST_SKIP() << "this file system makes no files without a name";
  ::close(probe);
  const int watch = ::inotify_init1(IN_NONBLOCK);
  ASSERT_GE(::inotify_add_watch(watch, folder.path().c_str(), IN_CREATE), 0);
  const auto file = open_temporary_file(folder.path());
  file->write(0, Bytes(3, std::byte{7}));
  EXPECT_EQ(file->read(0, 10), Bytes(3, std::byte{7}));
  char event[4096];
  EXPECT_LT(::read(watch, event, sizeof(event)), 0) << "a name was made";
  ::close(watch);
}

}  // namespace
}  // namespace cellmap
