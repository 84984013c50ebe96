#include "cellmap/client/cell_cache.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "codec/samples.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;

EncodedCell sample(std::uint32_t seed) { return encode_cell(random_cell(seed, 50, 1000)); }

TEST(CellCache, GivesBackWhatWasPutAlsoToALaterProcess) {
  const test::TempFolder folder;
  const EncodedCell cell = sample(1);
  CellCache({folder / "cache"}).put(cell);
  CellCache later({folder / "cache"});
  EXPECT_EQ(later.get(cell.hash), cell.bytes);
  EXPECT_FALSE(later.get(sample(2).hash));
}

TEST(CellCache, ADamagedFileIsMissingAndRemoved) {
  const test::TempFolder folder;
  const EncodedCell cell = sample(1);
  CellCache cache({folder.path()});
  const auto damage = [&](const auto& how) {
    cache.put(cell);
    how(cache.path_of(cell.hash));
    EXPECT_FALSE(cache.get(cell.hash));
    EXPECT_FALSE(fs::exists(cache.path_of(cell.hash)));
  };
  damage([](const fs::path& file) { fs::resize_file(file, fs::file_size(file) / 2); });
  damage([](const fs::path& file) { fs::resize_file(file, 0); });
  damage([](const fs::path& file) {
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    stream.seekp(400);
    stream.put('\x7f').put('\x01').put('\x7f');
  });
  const EncodedCell other = sample(2);
  damage([&](const fs::path& file) {  // a whole CELL, but not the one that the name promises
    std::ofstream(file, std::ios::binary)
        .write(reinterpret_cast<const char*>(other.bytes.data()),
               static_cast<std::streamsize>(other.bytes.size()));
  });
}

TEST(CellCache, TheLeastRecentlyUsedGoBeyondTheLimit) {
  const test::TempFolder folder;
  const std::size_t one = sample(0).bytes.size();
  CellCache cache({folder.path(), 3 * one + one / 2});
  const auto now = fs::file_time_type::clock::now();
  for (std::uint32_t seed = 0; seed < 3; ++seed) {
    cache.put(sample(seed));
    fs::last_write_time(cache.path_of(sample(seed).hash), now - std::chrono::hours(10 - seed));
  }
  EXPECT_TRUE(cache.get(sample(0).hash));  // the oldest file, but used just now
  cache.put(sample(3));
  EXPECT_TRUE(cache.get(sample(0).hash));
  EXPECT_FALSE(cache.get(sample(1).hash));
  EXPECT_TRUE(cache.get(sample(2).hash));
  EXPECT_TRUE(cache.get(sample(3).hash));
}

TEST(CellCache, RemembersHashesForEachMapOfEachServer) {
  const test::TempFolder folder;
  CellCache cache({folder.path()});
  const ContentHash a = sample(1).hash, b = sample(2).hash;
  cache.remember_hash("http://one/v1/maps/m", CellId{1}, a);
  cache.remember_hash("http://two/v1/maps/m", CellId{1}, b);
  EXPECT_EQ(cache.remembered_hash("http://one/v1/maps/m", CellId{1}), a);
  EXPECT_EQ(cache.remembered_hash("http://two/v1/maps/m", CellId{1}), b);
  EXPECT_FALSE(cache.remembered_hash("http://one/v1/maps/m", CellId{2}));
}

TEST(CellCache, AFolderThatCannotBeMadeIsAnError) {
  const test::TempFolder folder;
  folder.write("file", "not a folder");
  test::expect_error(
      ErrorCode::kIo, [&] { CellCache({folder / "file"}); }, "file");
}

}  // namespace
}  // namespace cellmap
