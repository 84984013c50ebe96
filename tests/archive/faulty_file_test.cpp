#include <gtest/gtest.h>

#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/update_archive.hpp"
#include "cellmap/archive/verify_archive.hpp"
#include "cellmap/core/error.hpp"
#include "support/archive_sample.hpp"

namespace cellmap::test {
namespace {

/// Memory in which the n-th operation, and every later one, finds no room. A write that does not
/// fit may have been done in part.
class FullFile : public MemoryFile {
 public:
  FullFile(Bytes bytes, int operations) : MemoryFile(std::move(bytes)), left_(operations) {}

  void write(std::uint64_t offset, std::span<const std::byte> bytes) override {
    if (--left_ < 0) {
      if (left_ == -1) MemoryFile::write(offset, bytes.first(bytes.size() / 2));
      throw Error(ErrorCode::kDiskFull, "no room");
    }
    MemoryFile::write(offset, bytes);
  }
  void sync() override {
    if (--left_ < 0) throw Error(ErrorCode::kDiskFull, "no room");
  }
  void resize(std::uint64_t size) override {
    if (--left_ < 0) throw Error(ErrorCode::kDiskFull, "no room");
    MemoryFile::resize(size);
  }

 private:
  int left_;
};

TEST(FullDisk, AnArchiveThatFoundNoRoomIsNotTakenForAWholeOne) {
  const ArchiveSample sample(4);
  for (int room = 0;; ++room) {
    SCOPED_TRACE(room);
    FullFile file({}, room);
    try {
      ArchiveWriter writer(file, sample.cells.front().lattice, {});
      for (std::size_t k = 0; k < sample.cells.size(); ++k) {
        writer.add(sample.ids[k], sample.cells[k]);
      }
      writer.finish(sample.contents);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::kDiskFull);
      // Only what is durable counts: before the last sync it may look whole or not.
      MemoryFile left(file.bytes());
      bool whole = false;
      try {
        whole = verify_archive(left).damage.empty();
      } catch (const Error&) {
      }
      if (whole) {
        EXPECT_EQ(ArchiveReader(borrowed(left)).cells().size(), sample.cells.size());
      }
      continue;
    }
    EXPECT_GT(room, 8);
    break;
  }
}

/// Poses are brought up to date in place: whatever fails, readers find the state before or the one
/// after it, whole.
TEST(FullDisk, AnUpdateThatFoundNoRoomLeavesTheStateBeforeIt) {
  const ArchiveSample sample(4);
  const Bytes before = sample.bytes();
  PoseGraph moved = sample.contents.graph;
  ++moved.revision;
  for (auto& [id, pose] : moved.nodes) pose.translation().z() += 0.5;
  for (int room = 0;; ++room) {
    SCOPED_TRACE(room);
    FullFile file(before, room);
    bool failed = false;
    try {
      update_archive(file, moved);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::kDiskFull);
      failed = true;
    }
    MemoryFile left(file.bytes());
    ArchiveReader reader(borrowed(left));
    const Revision revision = reader.pose_graph().revision;
    EXPECT_TRUE(revision == moved.revision || (failed && revision == moved.revision - 1));
    for (const ArchiveEntry& entry : reader.entries()) reader.cell(entry.cell);
    // And with room again the same update works.
    update_archive(left, moved);
    EXPECT_TRUE(verify_archive(left).damage.empty());
    EXPECT_EQ(ArchiveReader(borrowed(left)).pose_graph().revision, moved.revision);
    if (!failed) {
      EXPECT_GT(room, 3);
      break;
    }
  }
}

}  // namespace
}  // namespace cellmap::test
