#include "server/settings.hpp"

#include <gmock/gmock.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "cellmap/core/error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class SettingsTest : public ::testing::Test {
 protected:
  ~SettingsTest() override {
    for (const char* name : {"CELLMAPD_LOG_LEVEL", "CELLMAPD_LISTEN", "CELLMAPD_THREADS",
                             "CELLMAPD_CONFIG", "CELLMAPD_RATE_LIMIT", "CELLMAPD_BLOBS_ENDPOINT",
                             "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"}) {
      ::unsetenv(name);
    }
  }
  std::string write(const std::string& text) {
    std::ofstream(folder_ / "file") << text;
    return (folder_ / "file").string();
  }
  Settings read(std::vector<std::string> arguments) {
    const auto result = read_settings(arguments, out_, err_);
    EXPECT_TRUE(std::holds_alternative<Settings>(result)) << err_.str();
    return std::holds_alternative<Settings>(result) ? std::get<Settings>(result) : Settings();
  }
  /// What is said of arguments that are refused.
  std::string refusal(std::vector<std::string> arguments) {
    err_.str("");
    const auto result = read_settings(arguments, out_, err_);
    EXPECT_EQ(std::get<int>(result), 2);
    return err_.str();
  }

  cellmap::test::TempFolder folder_;
  std::ostringstream out_, err_;
};

TEST_F(SettingsTest, TheCommandLineGoesBeforeTheEnvironmentAndThatBeforeTheFile) {
  const auto file = write(
      "store = \"maps.db\"\nlog-level = \"error\"\nthreads = 3\nrate-limit = 7.5\n"
      "listen = [\"127.0.0.1:1\", \"unix:/run/x\"]\ninsecure = true\n");
  auto settings = read({"--config", file});
  EXPECT_EQ(settings.store, "maps.db");
  EXPECT_EQ(settings.log_level, "error");
  EXPECT_EQ(settings.threads, 3);
  EXPECT_EQ(settings.rate_limit, 7.5);
  EXPECT_TRUE(settings.insecure);
  EXPECT_THAT(settings.listen, ElementsAre("127.0.0.1:1", "unix:/run/x"));

  ::setenv("CELLMAPD_LOG_LEVEL", "warn", 1);
  ::setenv("CELLMAPD_THREADS", "4", 1);
  ::setenv("CELLMAPD_LISTEN", "127.0.0.1:2,[::1]:3", 1);
  settings = read({"--config", file, "--threads", "5"});
  EXPECT_EQ(settings.threads, 5);
  EXPECT_EQ(settings.log_level, "warn");
  EXPECT_THAT(settings.listen, ElementsAre("127.0.0.1:2", "[::1]:3"));
  EXPECT_EQ(settings.rate_limit, 7.5);
}

TEST_F(SettingsTest, TheEnvironmentMayNameTheFile) {
  ::setenv("CELLMAPD_CONFIG", write("store = \"a.db\"\n").c_str(), 1);
  EXPECT_EQ(read({}).store, "a.db");
  ::setenv("CELLMAPD_CONFIG", (folder_ / "missing").c_str(), 1);
  EXPECT_THAT(refusal({"--store", "a.db"}), HasSubstr("missing"));
}

TEST_F(SettingsTest, WhatNobodyKnowsIsRefused) {
  EXPECT_THAT(refusal({"--config", write("store = \"a\"\ncolour = \"red\"\n")}),
              HasSubstr("colour"));
  EXPECT_THAT(refusal({"--store", "a", "--colour", "red"}), HasSubstr("colour"));
  EXPECT_THAT(refusal({"--store", "a", "--trusted-proxy", "example.org"}), HasSubstr("address"));
  EXPECT_THAT(refusal({"--config", write("store = \"a\"\nthreads = \"many\"\n")}),
              HasSubstr("threads"));
  EXPECT_THAT(refusal({"--config", write("store = \"a\"\nlog-level = \"loud\"\n")}),
              HasSubstr("loud"));
  ::setenv("CELLMAPD_RATE_LIMIT", "-1", 1);
  EXPECT_THAT(refusal({"--store", "a"}), HasSubstr("rate-limit"));
}

TEST_F(SettingsTest, BlobsOfADatabaseMayBeObjectsWhoseKeysStandInTheEnvironment) {
  const std::string database = "postgresql://maps@db/maps";
  ::setenv("AWS_ACCESS_KEY_ID", "me", 1);
  ::setenv("AWS_SECRET_ACCESS_KEY", "secret", 1);
  ::setenv("CELLMAPD_BLOBS_ENDPOINT", "https://s3.example.org", 1);
  EXPECT_FALSE(objects_of(read({"--store", database})));
  const auto objects = objects_of(read({"--store", database, "--blobs", "s3://cells/a"}));
  ASSERT_TRUE(objects);
  EXPECT_EQ(objects->place, "s3://cells/a");
  EXPECT_EQ(objects->endpoint, "https://s3.example.org");
  EXPECT_EQ(objects->region, "us-east-1");
  EXPECT_EQ(objects->secret_key, "secret");
  EXPECT_THROW(objects_of(read({"--store", "maps.db", "--blobs", "s3://cells"})), Error);
  EXPECT_THROW(objects_of(read({"--store", database, "--blobs", "cells"})), Error);
  ::unsetenv("AWS_SECRET_ACCESS_KEY");
  EXPECT_THROW(objects_of(read({"--store", database, "--blobs", "s3://cells"})), Error);
}

TEST_F(SettingsTest, AStoreIsNeeded) { EXPECT_THAT(refusal({}), HasSubstr("--store")); }

TEST_F(SettingsTest, WhatIsPrintedAsInForceReadsAsTheSame) {
  ::setenv("CELLMAPD_THREADS", "4", 1);
  const auto result =
      read_settings({"--store", "a b.db", "--listen", "127.0.0.1:1", "--listen", "[::1]:2",
                     "--insecure", "--allow-origin", "*", "--place-memory", "77", "--place-servers",
                     "http://a:1,http://b:2", "--place-self", "http://b:2", "--print-config"},
                    out_, err_);
  EXPECT_EQ(std::get<int>(result), 0);
  ::unsetenv("CELLMAPD_THREADS");
  const auto again = read({"--config", write(out_.str())});
  EXPECT_EQ(again.store, "a b.db");
  EXPECT_EQ(again.threads, 4);
  EXPECT_EQ(again.place_memory_mib, 77u);
  EXPECT_THAT(again.place_servers, ElementsAre("http://a:1", "http://b:2"));
  EXPECT_EQ(again.place_self, "http://b:2");
  EXPECT_THAT(again.listen, ElementsAre("127.0.0.1:1", "[::1]:2"));
  EXPECT_THAT(again.allow_origins, ElementsAre("*"));
  EXPECT_TRUE(again.insecure);
  EXPECT_EQ(again.log_format, "text");
}

TEST_F(SettingsTest, TheServersOfADatabaseMayShareItsWorkAndThatOfAFileDoesAll) {
  const std::string database = "postgresql://maps@db/maps";
  EXPECT_EQ(read({"--store", "a.db"}).role, "all");
  EXPECT_EQ(read({"--store", "a.db"}).job_lease_s, 15);
  for (const char* role : {"api", "worker", "all"}) {
    Settings settings = read({"--store", database, "--role", role, "--job-lease", "2.5"});
    EXPECT_EQ(settings.role, role);
    EXPECT_EQ(settings.job_lease_s, 2.5);
    EXPECT_NO_THROW(check_role(settings));
    settings.store = "maps.db";
    if (settings.role == "all") {
      EXPECT_NO_THROW(check_role(settings));
    } else {
      EXPECT_THROW(check_role(settings), Error);
    }
  }
  EXPECT_THAT(refusal({"--store", database, "--role", "boss"}), HasSubstr("boss"));
  EXPECT_THAT(refusal({"--store", database, "--job-lease", "0"}), HasSubstr("job-lease"));
}

TEST_F(SettingsTest, ServersThatSearchTogetherAreAllNamedAndEachSaysWhichItIs) {
  const std::string a = "http://10.0.0.1:8080", b = "http://10.0.0.2:8080";
  const auto with = [&](std::vector<std::string> more, const std::string& store = "") {
    std::vector<std::string> all{"--store", store.empty() ? "postgresql://maps@db/maps" : store};
    all.insert(all.end(), more.begin(), more.end());
    return place_servers_of(read(all));
  };
  EXPECT_TRUE(with({}).servers.empty());
  EXPECT_TRUE(with({}, "maps.db").servers.empty());
  const auto options = with({"--place-servers", a + "/," + b, "--place-self", b, "--place-timeout",
                             "0.25", "--place-alone", "9"});
  EXPECT_THAT(options.servers, ElementsAre(a, b));
  EXPECT_EQ(options.self, b);
  EXPECT_EQ(options.timeout.count(), 250);
  EXPECT_EQ(options.alone, 9u);
  const std::string both = a + "," + b;
  const auto refused = [&](std::vector<std::string> more, const std::string& why,
                           const std::string& store = "") {
    try {
      with(std::move(more), store);
      ADD_FAILURE() << why;
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::kInvalidArgument);
      EXPECT_THAT(error.what(), HasSubstr(why));
    }
  };
  refused({"--place-servers", both}, "--place-self");
  refused({"--place-self", a}, "missing");
  refused({"--place-servers", both, "--place-self", "http://10.0.0.3:8080"}, "none of");
  refused({"--place-servers", a + "," + a, "--place-self", a}, "twice");
  refused({"--place-servers", both + ",10.0.0.3:8080", "--place-self", a}, "10.0.0.3");
  refused({"--place-servers", a + "/maps", "--place-self", a}, "/maps");
  refused({"--place-servers", both, "--place-self", a}, "file", "maps.db");
  refused({"--place-servers", both, "--place-self", a, "--role", "worker"}, "worker");
}

TEST_F(SettingsTest, OnlyThisMachineIsServedUnlessSomebodyIsAskedForTokens) {
  Settings settings;
  settings.listen = {"127.0.0.1:0", "unix:/tmp/x", "[::1]:0"};
  EXPECT_NO_THROW(check_addresses(settings));
  for (const char* address :
       {"0.0.0.0:80", "[::]:80", "192.0.2.1:80", "maps.example.org:80", "127.evil.example:80"}) {
    settings = {};
    settings.listen.push_back(address);
    try {
      check_addresses(settings);
      ADD_FAILURE() << address;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr("cellmap token create"));
      EXPECT_THAT(error.what(), HasSubstr("--insecure"));
    }
    settings.tokens = "tokens";
    EXPECT_NO_THROW(check_addresses(settings));
    settings.tokens.clear();
    settings.insecure = true;
    EXPECT_NO_THROW(check_addresses(settings));
  }
}

}  // namespace
}  // namespace cellmap::server
