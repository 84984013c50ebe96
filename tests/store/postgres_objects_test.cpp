#include <gtest/gtest.h>

#include <map>
#include <set>

#include "cellmap/store/copy_map.hpp"
#include "cellmap/store/object_store.hpp"
#include "cellmap/store/postgres_store.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "store/postgres_engine.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

StoreEngine objects_engine() {
  return {"postgres with objects",
          [](const std::filesystem::path& folder) -> std::unique_ptr<Store> {
            const auto objects = objects_for(folder);
            if (!postgres_address() || !objects) return nullptr;
            return open_postgres_store(postgres_address_for(folder), {.objects = objects});
          }};
}

INSTANTIATE_TEST_SUITE_P(PostgresObjects, StoreContract, ::testing::Values(objects_engine()));

class PostgresObjectsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto objects = objects_for(folder_.path());
    if (!postgres_address()) GTEST_SKIP() << "no PostgreSQL server runs for this test";
    if (!objects) GTEST_SKIP() << "NO OBJECT STORE RUNS FOR THIS TEST (Node.js, npm)";
    options_ = *objects;
    address_ = postgres_address_for(folder_.path());
  }

  std::unique_ptr<Store> open() const {
    return open_postgres_store(address_, {.objects = options_});
  }
  std::map<std::string, std::uint64_t> listed() const {
    std::map<std::string, std::uint64_t> all;
    open_object_store(options_)->list(
        [&](const StoredObject& object) { all[object.name] = object.bytes; });
    return all;
  }
  std::int64_t asked(const char* sql) const { return PostgresConnection(address_).integer(sql); }

  TempFolder folder_;
  ObjectStoreOptions options_;
  std::string address_;
};

/// Takes requests and answers none, like a service behind a network that is cut.
ObjectStoreOptions nobody(ObjectStoreOptions options) {
  options.endpoint = "http://127.0.0.1:1";
  return options;
}

TEST_F(PostgresObjectsTest, EachFrameIsAnObjectNamedByItsHashAndTheDatabaseHasNoneOfIt) {
  const auto store = open();
  store->create_map("town", {});
  store->commit("town", adding({make_cell(1), make_cell(2), make_cell(3)}));
  std::map<std::string, std::uint64_t> expected;
  std::uint64_t bytes = 0;
  for (std::uint32_t id = 1; id <= 3; ++id) {
    const Bytes frame = *store->stored_cell("town", {id}).frame;
    const std::string hash = to_hex(sha256(frame));
    expected[hash.substr(0, 2) + "/" + hash] = frame.size();
    bytes += frame.size();
  }
  EXPECT_EQ(listed(), expected);
  EXPECT_EQ(asked("SELECT COALESCE(SUM(LENGTH(frame)), 0) FROM blob"), 0);
  EXPECT_EQ(store->map("town").stored_bytes, bytes);
  const MapInfo before = store->map("town");
  MapUpdate removal;
  removal.remove_sessions.insert("drive");
  store->commit("town", removal);
  EXPECT_EQ(before.cells, 3u);
  EXPECT_EQ(store->map("town").stored_bytes, 0u);
}

TEST_F(PostgresObjectsTest, AnObjectThatIsMissingOrAnotherIsDamageAndNeverWrongBytes) {
  open()->create_map("town", {});
  open()->commit("town", adding({make_cell(1), make_cell(2), make_cell(3)}));
  const auto objects = open_object_store(options_);
  const auto name_of = [&](std::uint32_t id) {
    const std::string hash = to_hex(sha256(*open()->stored_cell("town", {id}).frame));
    return hash.substr(0, 2) + "/" + hash;
  };
  objects->remove(name_of(1));
  Bytes other = *open()->stored_cell("town", {2}).frame;
  const std::string second = name_of(2), third = name_of(3);
  other[other.size() / 2] ^= std::byte{1};
  objects->put(second, other);
  objects->put(third, Bytes(100'000));
  const auto store = open();
  expect_error(
      ErrorCode::kCorruptData, [&] { store->stored_cell("town", {1}); }, "missing");
  expect_error(
      ErrorCode::kCorruptData, [&] { store->stored_cell("town", {2}); }, "damaged");
  expect_error(
      ErrorCode::kCorruptData, [&] { store->stored_cell("town", {3}); }, "longer");
}

TEST_F(PostgresObjectsTest, WithoutTheObjectStoreNothingIsWrittenAndWhatIsKnownIsStillRead) {
  open()->create_map("town", {});
  open()->commit("town", adding({make_cell(1)}));
  const auto store = open_postgres_store(address_, {.objects = nobody(options_)});
  expect_error(
      ErrorCode::kUnavailable, [&] { store->commit("town", adding({make_cell(2)})); }, "try again");
  expect_error(ErrorCode::kUnavailable, [&] { store->stored_cell("town", {1}); });
  expect_error(ErrorCode::kUnavailable, [&] { store->check_ready(); });
  EXPECT_EQ(store->map("town").cells, 1u);
  store->commit("town", moving({{CellId{1}, pose_at(3, 0)}}));  // no bytes of CELLs in it
  EXPECT_EQ(open()->pose_graph("town").nodes.at({1}).translation().x(), 3);
  EXPECT_NO_THROW(open()->check_ready());
}

TEST_F(PostgresObjectsTest, ADatabaseMayHaveFramesOfBothKinds) {
  const auto plain = open_postgres_store(address_);
  plain->create_map("town", {});
  plain->commit("town", adding({make_cell(1)}));
  const auto store = open();
  store->commit("town", adding({make_cell(2)}));
  EXPECT_EQ(listed().size(), 1u);
  EXPECT_EQ(*store->stored_cell("town", {1}).frame, *plain->stored_cell("town", {1}).frame);
  expect_error(
      ErrorCode::kUnsupported, [&] { plain->stored_cell("town", {2}); }, "--blobs");
}

TEST_F(PostgresObjectsTest, CopiesGoInAndOutAndKeepEveryByte) {
  const auto file = open_sqlite_store(folder_ / "maps.db");
  file->create_map("town", {});
  file->commit("town", adding({make_cell(1), make_cell(2)}));
  const auto store = open();
  EXPECT_EQ(copy_map(*file, *store, "town").cells, 2u);
  EXPECT_EQ(listed().size(), 2u);
  const auto back = open_sqlite_store(folder_ / "back.db");
  copy_map(*store, *back, "town");
  for (const CellId id : {CellId{1}, CellId{2}}) {
    EXPECT_EQ(*store->stored_cell("town", id).frame, *file->stored_cell("town", id).frame);
    EXPECT_EQ(*back->stored_cell("town", id).frame, *file->stored_cell("town", id).frame);
  }
  EXPECT_EQ(back->map("town").stored_bytes, file->map("town").stored_bytes);
}

TEST_F(PostgresObjectsTest, WhatNoRowNamesIsHarmlessAndPutAgainByTheNextUpload) {
  const auto store = open();
  store->create_map("town", {});
  store->commit("town", adding({make_cell(1)}));
  store->delete_map("town");
  EXPECT_EQ(listed().size(), 1u);  // left there
  const auto left = listed();
  open_object_store(options_)->remove(left.begin()->first);
  store->create_map("town", {});
  store->commit("town", adding({make_cell(1)}));
  EXPECT_EQ(listed(), left);
  EXPECT_NO_THROW(open()->stored_cell("town", {1}));
}

}  // namespace
}  // namespace cellmap::test
