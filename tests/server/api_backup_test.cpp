#include "cellmap/archive/byte_source.hpp"
#include "cellmap/store/check_store.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kBackup = "/v1/backup";

class ApiBackup : public ApiTest {
 protected:
  ApiBackup() {
    ApiOptions with_folder = options();
    with_folder.spool_folder = folder_.path();
    start(std::move(with_folder));
    make_map();
    put_street(3);
  }
  static Bytes bytes_of(const Response& response) {
    const auto* part = std::get_if<FileBody>(&response.body);
    EXPECT_TRUE(part) << body_view(response);
    return part ? part->file->read(part->offset, part->length) : Bytes();
  }
};

TEST_F(ApiBackup, IsAStoreOfAllMapsAndLeavesNoFileBehind) {
  const auto response = get(kBackup);
  ASSERT_EQ(response.status, 200) << body_view(response);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "cellmap-backup.db"));
  const auto file = folder_.write("copy.db", to_text(bytes_of(response)));
  EXPECT_TRUE(check_store(file).findings.empty());
  EXPECT_EQ(open_sqlite_store(file)->map("town").cells, 3u);
}

TEST_F(ApiBackup, IsReadInPartsUntilItsLastByte) {
  const auto begin = get(kBackup, {{"Range", "bytes=0-99"}});
  ASSERT_EQ(begin.status, 206);
  const std::string etag(begin.headers.get("ETag").value());
  put_cell(4, street_cell(3, 18));  // which it does not have
  const auto rest = get(kBackup, {{"Range", "bytes=100-"}, {"If-Match", etag}});
  ASSERT_EQ(rest.status, 206);
  Bytes bytes = bytes_of(begin);
  const Bytes more = bytes_of(rest);
  bytes.insert(bytes.end(), more.begin(), more.end());
  const auto file = folder_.write("copy.db", to_text(bytes));
  EXPECT_EQ(open_sqlite_store(file)->map("town").cells, 3u);
  expect_problem(get(kBackup, {{"Range", "bytes=0-99"}, {"If-Match", etag}}), 412,
                 "precondition-failed");
  expect_problem(get(kBackup, {{"Range", "bytes=99999999999-"}}), 416, "range-not-satisfiable");
}

TEST_F(ApiBackup, AMapInTheMakingIsNobodysBusiness) {
  expect_problem(get("/v1/maps/.1"), 404, "not-found");
  expect_problem(send("DELETE", "/v1/maps/%2e1"), 404, "not-found");
}

}  // namespace
}  // namespace cellmap::server::test
