#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class ApiViewer : public ApiTest {
 protected:
  void start_with_viewer() {
    folder_.write("viewer/index.html", "<!doctype html><title>viewer</title>");
    folder_.write("viewer/assets/app-1a2b.js", std::string(1000, ';'));
    folder_.write("viewer/assets/app-1a2b.css", "body { margin: 0 }");
    folder_.write("viewer/api/index.html", "<!doctype html><title>reference</title>");
    folder_.write("secret.js", "secret");
    std::filesystem::create_symlink(folder_ / "secret.js", folder_ / "viewer/assets/link.js");
    start_with(folder_ / "viewer");
  }
  void start_with(const std::filesystem::path& viewer) {
    ApiOptions with_viewer = options();
    with_viewer.viewer = viewer;
    start(with_viewer);
  }
};

TEST_F(ApiViewer, WithoutAViewerThePageSaysHowToBuildIt) {
  const auto page = get("/");
  EXPECT_EQ(page.status, 200);
  EXPECT_THAT(std::string(body_view(page)), HasSubstr("--target web"));
  expect_problem(get("/assets/app-1a2b.js"), 404, "not-found");
  expect_problem(get("/api/"), 404, "not-found");
}

TEST_F(ApiViewer, TheReferenceOfTheApiHasAnAddressThatCanBeGuessed) {
  start_with_viewer();
  const auto page = get("/api/");
  EXPECT_THAT(std::string(body_view(page)), HasSubstr("reference"));
  EXPECT_EQ(page.headers.get("Content-Type"), "text/html; charset=utf-8");
  EXPECT_EQ(page.headers.get("Cache-Control"), "no-cache");
  EXPECT_THAT(page.headers.get("Content-Security-Policy").value_or(""),
              HasSubstr("default-src 'none'"));
  EXPECT_EQ(get("/api/", {{"If-None-Match", *page.headers.get("ETag")}}).status, 304);
  const auto without_slash = get("/api");
  EXPECT_EQ(without_slash.status, 308);
  EXPECT_EQ(without_slash.headers.get("Location"), "api/");
}

TEST_F(ApiViewer, ThePageIsAskedForAgainAndAllowsOnlyThisServer) {
  start_with_viewer();
  const auto page = get("/");
  EXPECT_THAT(std::string(body_view(page)), HasSubstr("viewer"));
  EXPECT_EQ(page.headers.get("Content-Type"), "text/html; charset=utf-8");
  EXPECT_EQ(page.headers.get("Cache-Control"), "no-cache");
  EXPECT_EQ(page.headers.get("X-Content-Type-Options"), "nosniff");
  const auto policy = page.headers.get("Content-Security-Policy").value_or("");
  EXPECT_THAT(policy, HasSubstr("default-src 'none'"));
  EXPECT_THAT(policy, Not(HasSubstr("unsafe")));
  EXPECT_THAT(policy, Not(HasSubstr("http")));
  EXPECT_EQ(get("/", {{"If-None-Match", *page.headers.get("ETag")}}).status, 304);
}

TEST_F(ApiViewer, HashedFilesNeverChangeAndHaveTheirTypes) {
  start_with_viewer();
  const auto script = get("/assets/app-1a2b.js");
  EXPECT_EQ(script.headers.get("Content-Type"), "text/javascript; charset=utf-8");
  EXPECT_THAT(script.headers.get("Cache-Control").value_or(""), HasSubstr("immutable"));
  EXPECT_EQ(get("/assets/app-1a2b.css").headers.get("Content-Type"), "text/css; charset=utf-8");
  EXPECT_EQ(get("/assets/app-1a2b.js", {{"If-None-Match", *script.headers.get("ETag")}}).status,
            304);
}

TEST_F(ApiViewer, FilesTravelCompressedWhereThatIsShorter) {
  start_with_viewer();
  const auto script = get("/assets/app-1a2b.js", {{"Accept-Encoding", "gzip, zstd"}});
  EXPECT_EQ(script.headers.get("Content-Encoding"), "zstd");
  EXPECT_EQ(to_text(zstd_decompress(as_bytes(body_view(script)), 2000)), std::string(1000, ';'));
  EXPECT_FALSE(get("/assets/app-1a2b.js").headers.get("Content-Encoding"));
}

TEST_F(ApiViewer, NothingOutsideOfItsFolderIsServed) {
  start_with_viewer();
  for (const char* path : {"/assets/link.js", "/assets/..%2f..%2fsecret.js", "/assets/%2e%2e",
                           "/assets/../secret.js", "/assets/index.html", "/index.html"}) {
    expect_problem(get(path), 404, "not-found");
  }
}

TEST_F(ApiViewer, AFolderThatHoldsNoViewerIsAnError) {
  EXPECT_THROW(start_with(folder_ / "nowhere"), Error);
}

}  // namespace
}  // namespace cellmap::server::test
