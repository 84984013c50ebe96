#include <gmock/gmock.h>
#include <sys/stat.h>

#include <cstdlib>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sstream>

#include "client/cli/command_line.hpp"
#include "client/fake_server.hpp"
#include "server/auth/token_file.hpp"
#include "support/temp_folder.hpp"

// Tokens: sent by the client, made by the command line.

namespace cellmap::cli {
namespace {

using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

class TokenTest : public testing::Test {
 protected:
  ~TokenTest() override {
    ::unsetenv("CELLMAP_TOKEN");
    ::unsetenv("CELLMAP_TOKEN_FILE");
  }

  struct Outcome {
    int exit_code = 0;
    std::string out, err;
  };
  static Outcome run(const std::vector<std::string>& arguments) {
    std::ostringstream out, err;
    const int code = run_command_line(arguments, out, err);
    return {code, out.str(), err.str()};
  }

  /// A server that notes what it was sent.
  test::FakeServer server{[this](const httplib::Request& request, httplib::Response& response) {
    const std::lock_guard lock(mutex_);
    sent_.push_back(request.get_header_value("Authorization"));
    if (request.path.find("/events") != std::string::npos) {
      response.set_content("event: end\ndata: {}\n\n", "text/event-stream");
    } else {
      test::answer_json(response, R"({"maps":[]})");
    }
  }};
  std::vector<std::string> sent() {
    const std::lock_guard lock(mutex_);
    return sent_;
  }

  std::mutex mutex_;
  std::vector<std::string> sent_;
  test::TempFolder folder_;
  const std::string tokens_ = (folder_ / "tokens").string();
};

TEST_F(TokenTest, EveryRequestOfAClientBringsItsToken) {
  ClientOptions options = test::options_for(server);
  options.token = "cellmap_secret";
  Client client(options);
  client.maps();
  client.follow_revisions("town", {}, [](const auto&) { return false; });
  EXPECT_EQ(sent().size(), 2u);
  EXPECT_THAT(sent(), Each("Bearer cellmap_secret"));
  ClientOptions without = test::options_for(server);
  Client(without).maps();
  EXPECT_EQ(sent().back(), "");
}

TEST_F(TokenTest, ATokenThatWouldBreakTheRequestIsRefused) {
  for (const std::string& token :
       {std::string("a b"), std::string("a\r\nX: y"), std::string(200, 'a')}) {
    ClientOptions options = test::options_for(server);
    options.token = token;
    EXPECT_THROW(Client{options}, Error);
  }
}

TEST_F(TokenTest, VerbsTakeItFromAFileOrTheEnvironment) {
  std::ofstream(folder_ / "secret") << "cellmap_of_file\n";
  ::setenv("CELLMAP_TOKEN", "cellmap_of_environment", 1);
  EXPECT_EQ(run({"maps", "--server", server.url()}).exit_code, 0);
  EXPECT_EQ(sent().back(), "Bearer cellmap_of_environment");
  const std::string file = (folder_ / "secret").string();
  EXPECT_EQ(run({"maps", "--server", server.url(), "--token-file", file}).exit_code, 0);
  EXPECT_EQ(sent().back(), "Bearer cellmap_of_file");
  ::unsetenv("CELLMAP_TOKEN");
  ::setenv("CELLMAP_TOKEN_FILE", file.c_str(), 1);
  EXPECT_EQ(run({"maps", "--server", server.url()}).exit_code, 0);
  EXPECT_EQ(sent().back(), "Bearer cellmap_of_file");
  ::unsetenv("CELLMAP_TOKEN_FILE");

  std::ofstream(folder_ / "two") << "one two\n";
  EXPECT_THAT(
      run({"maps", "--server", server.url(), "--token-file", (folder_ / "two").string()}).err,
      HasSubstr("should hold one token"));
  EXPECT_NE(run({"maps", "--server", server.url(), "--token", "x"}).exit_code, 0)
      << "a secret on the command line is everyone's";
}

TEST_F(TokenTest, AnArchiveOfSomebodyElseGetsNoToken) {
  ::setenv("CELLMAP_TOKEN", "cellmap_secret", 1);
  run({"cells", "town", "--archive", server.url() + "/town.cellmap"});
  run({"cells", "town", "--archive", server.url() + "/town.cellmap", "--server",
       "http://maps.example.org"});
  ASSERT_GE(sent().size(), 2u);
  EXPECT_THAT(sent(), Each(""));
  run({"cells", "town", "--archive", server.url() + "/v1/maps/town/archive", "--server",
       server.url()});
  EXPECT_EQ(sent().back(), "Bearer cellmap_secret");
}

TEST_F(TokenTest, CreatePrintsTheSecretOnceAndKeepsItsHash) {
  const auto made =
      run({"token", "create", "cart-7", "--tokens", tokens_, "--scope", "map:read,map:write",
           "--maps", "town,harbour", "--expires", "90d", "--rate", "20"});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const std::string secret = made.out.substr(0, made.out.size() - 1);
  const auto tokens = auth::read_token_file(tokens_);
  ASSERT_EQ(tokens.size(), 1u);
  EXPECT_EQ(tokens[0].hash, auth::hash_of_secret(secret));
  EXPECT_THAT(tokens[0].scopes, ElementsAre(auth::Scope::kMapRead, auth::Scope::kMapWrite));
  EXPECT_THAT(tokens[0].maps, ElementsAre("harbour", "town"));
  EXPECT_EQ(tokens[0].requests_per_s, 20);
  const auto days = *tokens[0].expires - std::chrono::system_clock::now();
  EXPECT_NEAR(std::chrono::duration<double>(days).count(), 90 * 86'400, 60);
  std::ifstream file(tokens_);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  EXPECT_THAT(text, Not(HasSubstr(secret)));
  const auto listed = run({"token", "list", "--tokens", tokens_});
  EXPECT_THAT(listed.out, HasSubstr("cart-7 map:read,map:write maps=harbour,town expires="));
  EXPECT_THAT(listed.out, Not(HasSubstr("sha256")));
}

TEST_F(TokenTest, CreateListAndRevokeInJson) {
  const auto made = client::Json::parse(
      run({"token", "create", "guest", "--tokens", tokens_, "--scope", "relocalise", "--json"})
          .out);
  EXPECT_TRUE(auth::is_secret(made.at("token").get<std::string>()));
  const auto listed =
      client::Json::parse(run({"token", "list", "--tokens", tokens_, "--json"}).out);
  ASSERT_EQ(listed.at("tokens").size(), 1u);
  EXPECT_EQ(listed["tokens"][0].at("name"), "guest");
  EXPECT_EQ(listed["tokens"][0].at("expires"), nullptr);
  EXPECT_EQ(run({"token", "revoke", "guest", "--tokens", tokens_}).exit_code, 0);
  EXPECT_EQ(run({"token", "revoke", "guest", "--tokens", tokens_}).exit_code, 4);
  EXPECT_TRUE(auth::read_token_file(tokens_).empty());
}

TEST_F(TokenTest, CreateRefusesWhatMakesNoSense) {
  const auto create = [&](std::vector<std::string> more) {
    std::vector<std::string> all{"token", "create", "a", "--tokens", tokens_};
    all.insert(all.end(), more.begin(), more.end());
    return run(all).exit_code;
  };
  EXPECT_NE(create({}), 0);
  EXPECT_NE(create({"--scope", "everything"}), 0);
  EXPECT_EQ(create({"--scope", "admin", "--expires", "yesterday"}), 3);
  EXPECT_EQ(create({"--scope", "admin", "--expires", "2020-01-01"}), 3);
  EXPECT_EQ(create({"--scope", "admin", "--expires", "0d"}), 3);
  EXPECT_EQ(create({"--scope", "admin", "--maps", "../etc"}), 3);
  EXPECT_NE(create({"--scope", "admin", "--rate", "-1"}), 0);
  EXPECT_FALSE(std::filesystem::exists(tokens_));
  EXPECT_EQ(create({"--scope", "admin"}), 0);
  EXPECT_EQ(create({"--scope", "admin"}), 5);
}

}  // namespace
}  // namespace cellmap::cli
