#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/store_archive.hpp"
#include "cellmap/archive/verify_archive.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kTown = "/v1/maps/town/archive";
constexpr const char* kType = "application/vnd.cellmap.archive";

class ApiArchive : public ApiTest {
 protected:
  static Bytes bytes_of(const Response& response) {
    const auto* part = std::get_if<FileBody>(&response.body);
    EXPECT_TRUE(part) << body_view(response);
    return part ? part->file->read(part->offset, part->length) : Bytes();
  }
  static ArchiveReader reader_of(const Response& response) {
    return ArchiveReader(std::make_unique<MemoryFile>(bytes_of(response)));
  }
  Response put(const std::string& map, const Bytes& bytes, std::vector<Headed> headers = {}) {
    headers.push_back({"Content-Type", kType});
    return send("PUT", "/v1/maps/" + map + "/archive", to_text(bytes), headers);
  }
};

TEST_F(ApiArchive, AMapGoesOutAndComesBackAsAnother) {
  make_map();
  put_street(4);
  for (const std::string encoding : {"", "?encoding=raw", "?encoding=compact&bound=0.01"}) {
    const auto response = get(kTown + encoding);
    ASSERT_EQ(response.status, 200) << body_view(response);
    EXPECT_EQ(response.headers.get("Content-Type"), kType);
    MemoryFile file(bytes_of(response));
    EXPECT_TRUE(verify_archive(file).damage.empty());
    const std::string name = "copy" + std::to_string(encoding.size());
    const auto made = put(name, file.bytes());
    ASSERT_EQ(made.status, 201) << body_view(made);
    EXPECT_EQ(made.headers.get("Location"), "/v1/maps/" + name);
    EXPECT_EQ(json_of(made)["cells"], 4);
    const bool exact = encoding.find("compact") == std::string::npos;
    for (std::uint32_t id = 1; id <= 4; ++id) {
      const CellId cell{id};
      EXPECT_EQ(store_->cell(name, cell).hash == store_->cell("town", cell).hash, exact);
      EXPECT_EQ(store_->cell(name, cell).T_map_cell.matrix(),
                store_->cell("town", cell).T_map_cell.matrix());
    }
  }
}

TEST_F(ApiArchive, APartIsReadByRangeUnderOneEntityTag) {
  make_map();
  put_street(2);
  const auto whole = get(kTown);
  const auto etag = whole.headers.get("ETag").value();
  const Bytes bytes = bytes_of(whole);
  const auto part = get(kTown, {{"Range", "bytes=100-299"}, {"If-Match", etag}});
  ASSERT_EQ(part.status, 206);
  EXPECT_EQ(part.headers.get("Content-Range"), "bytes 100-299/" + std::to_string(bytes.size()));
  EXPECT_EQ(bytes_of(part), Bytes(bytes.begin() + 100, bytes.begin() + 300));
  EXPECT_EQ(get(kTown, {{"If-None-Match", etag}}).status, 304);
  EXPECT_EQ(get(kTown, {{"Range", "bytes=99999999-"}}).status, 416);
  EXPECT_NE(get(kTown + std::string("?encoding=raw")).headers.get("ETag"), etag);

  put_cell(3, street_cell(2, 12));  // another revision is another file
  expect_problem(get(kTown, {{"Range", "bytes=0-9"}, {"If-Match", etag}}), 412,
                 "precondition-failed");
  EXPECT_EQ(reader_of(get(kTown)).head().cells, 3u);
}

TEST_F(ApiArchive, WhatIsNoPartOfARevisionChangesTheEntityTagToo) {
  make_map();
  put_street(1);
  const auto before = get(kTown).headers.get("ETag");
  store_->set_georeference("town", Georeference{49, 8, 100, Eigen::Matrix3d::Identity()});
  const auto after = get(kTown);
  EXPECT_NE(after.headers.get("ETag"), before);
  EXPECT_EQ(reader_of(after).footer().georeference->latitude_deg, 49);
}

TEST_F(ApiArchive, WhatCannotBeServedIsRefused) {
  expect_problem(get(kTown), 404, "not-found");
  make_map();
  expect_problem(get(std::string(kTown) + "?encoding=zip"), 400, "invalid-argument");
  expect_problem(get(std::string(kTown) + "?bound=0.02"), 400, "invalid-argument");
  expect_problem(get(std::string(kTown) + "?encoding=compact&bound=5"), 400, "invalid-argument");
}

TEST_F(ApiArchive, WhatIsNoArchiveMakesNoMap) {
  make_map();
  put_street(2);
  Bytes bytes = bytes_of(get(kTown));
  expect_problem(put("town", bytes), 409, "already-exists");
  expect_problem(put("Bad-Name", bytes), 400, "invalid-argument");
  expect_problem(put("copy", bytes, {{"Content-Encoding", "zstd"}}), 415, "unsupported");
  bytes[kArchiveFirstReadBytes + 100] ^= std::byte{1};
  expect_problem(put("copy", bytes), 422, "corrupt-data");
  bytes.resize(20'000);
  expect_problem(put("copy", bytes), 422, "corrupt-data");
  expect_problem(put("copy", {}), 422, "corrupt-data");
  EXPECT_EQ(store_->maps().size(), 1u);
}

TEST_F(ApiArchive, AnUploadIsBounded) {
  ApiOptions small = options();
  small.max_archive_bytes = 1000;
  start(small);
  EXPECT_EQ(api_->max_body("PUT", "/v1/maps/m/archive"), 1000u);
  EXPECT_TRUE(api_->may_wait("GET", "/v1/maps/m/archive")) << "for its reader";
  EXPECT_NE(api_->file_for_body("PUT", "/v1/maps/m/archive?x=y"), nullptr);
  EXPECT_EQ(api_->file_for_body("GET", "/v1/maps/m/archive"), nullptr);
  EXPECT_EQ(api_->file_for_body("PUT", "/v1/maps/m/cells/1"), nullptr);
  expect_problem(put("copy", Bytes(1001)), 413, "too-large");
}

}  // namespace
}  // namespace cellmap::server::test
