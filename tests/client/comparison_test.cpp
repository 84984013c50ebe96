#include "cellmap/client/comparison.hpp"

#include <gtest/gtest.h>

#include "client/fake_server.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

TEST(ClientComparison, IsPutAndReadAsItIs) {
  std::string kept, path, type;
  test::FakeServer server([&](const httplib::Request& request, httplib::Response& response) {
    path = request.path;
    if (request.method == "PUT") {
      kept = request.body;
      type = request.get_header_value("Content-Type");
    }
    test::answer_json(response, kept);
  });
  put_comparison(test::options_for(server), "town", R"({"rows":[]})");
  EXPECT_EQ(path, "/v1/maps/town/comparison");
  EXPECT_EQ(type, "application/json");
  EXPECT_EQ(comparison_text(test::options_for(server), "town"), R"({"rows":[]})");
}

TEST(ClientComparison, ThatIsNotThereIsNotFound) {
  test::FakeServer server([](const httplib::Request&, httplib::Response& response) {
    test::answer_problem(response, 404, "not-found", "none");
  });
  test::expect_error(ErrorCode::kNotFound,
                     [&] { comparison_text(test::options_for(server), "town"); });
}

}  // namespace
}  // namespace cellmap
