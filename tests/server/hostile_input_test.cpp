#include <cmath>
#include <functional>
#include <limits>

#include "cellmap/codec/zstd.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kJson = "application/json";
constexpr const char* kOctets = "application/octet-stream";
constexpr const char* kArchive = "application/vnd.cellmap.archive";

/// Said at once where it is short, made when it is sent where it is large: every test of the
/// program would pay for it.
struct Body {
  Body(const char* text) : make([text = std::string(text)] { return text; }) {}
  Body(std::string text) : make([text = std::move(text)] { return text; }) {}
  Body(std::string (*maker)()) : make(maker) {}
  std::function<std::string()> make;
};

struct Attack {
  std::string name;
  std::string method, target, type;
  Body body;
  int status;
  std::string code;
  std::string coding = "identity";
};

void PrintTo(const Attack& attack, std::ostream* stream) { *stream << attack.name; }

/// Input that nobody means well with: it is refused with a documented status, at a bounded cost,
/// and the server works as before.
class HostileInput : public ApiTest, public ::testing::WithParamInterface<Attack> {};

TEST_P(HostileInput, IsRefusedAndNothingChanges) {
  make_map();
  const auto before = json_of(get("/v1/maps"));
  const Attack& attack = GetParam();
  const auto answer = send(attack.method, attack.target, attack.body.make(),
                           {{"Content-Type", attack.type}, {"Content-Encoding", attack.coding}});
  expect_problem(answer, attack.status, attack.code);
  EXPECT_EQ(json_of(get("/v1/maps")), before);
}

std::string points(float value, std::size_t count) {
  std::string bytes;
  const float point[4] = {value, value, value, 0};
  for (std::size_t i = 0; i < count; ++i) {
    bytes.append(reinterpret_cast<const char*>(point), sizeof(point));
  }
  return bytes;
}

std::string zstd(std::size_t zeros) { return to_text(zstd_compress(Bytes(zeros))); }

Attack json(const std::string& name, const std::string& target, const std::string& body,
            const std::string& method = "POST") {
  return {name, method, target, kJson, body, 400, "invalid-argument"};
}

Attack loop(const std::string& name, const std::string& pose) {
  return json(name, "/v1/maps/town/loops", R"({"from":1,"to":2,"pose":)" + pose + "}");
}

Attack path(const std::string& name, const std::string& path) {
  return json(name, "/v1/maps/town/jobs",
              R"({"kind":"ingest","session":"s","path":")" + path + "\"}");
}

Attack map_name(const std::string& name, const std::string& map) {
  return json(name, "/v1/maps", R"({"name":")" + map + "\"}");
}

Attack session(const std::string& name, const std::string& session) {
  return json(name, "/v1/maps/town/sessions", R"({"name":")" + session + "\"}");
}

Attack scan(const std::string& name, Body body, int status, const std::string& code,
            const std::string& coding = "identity") {
  return {name, "POST", "/v1/maps/town/relocalise", kOctets, std::move(body), status, code, coding};
}

std::string name_of(const testing::TestParamInfo<Attack>& info) { return info.param.name; }

INSTANTIATE_TEST_SUITE_P(
    Json, HostileInput,
    ::testing::Values(
        json("Deep", "/v1/maps", std::string(20'000, '[') + std::string(20'000, ']')),
        json("DeepAndCutOff", "/v1/maps", std::string(60'000, '[')),
        json("DuplicateKeys", "/v1/maps", R"({"name":"a","name":"b"})"),
        json("NotANumber", "/v1/maps/town/georeference",
             R"({"latitude_deg":NaN,"longitude_deg":0,"height_m":0,"q_enu_map":[0,0,0,1]})", "PUT"),
        json("BeyondDoubles", "/v1/maps/town/georeference",
             R"({"latitude_deg":1e999,"longitude_deg":0,"height_m":0,"q_enu_map":[0,0,0,1]})",
             "PUT"),
        json(
            "TooManyIds", "/v1/maps/town/cells:batch",
            R"({"ids":[)" +
                [] {
                  std::string ids = "1";
                  for (int i = 0; i < 20'000; ++i) ids += ",1";
                  return ids;
                }() +
                "]}"),
        json(
            "TooManyHashes", "/v1/maps/town/sessions/drive/cells:lacking",
            R"({"hashes":[)" +
                [] {
                  const std::string hash = '"' + std::string(64, 'a') + '"';
                  std::string hashes = hash;
                  for (int i = 0; i < 10'000; ++i) hashes += "," + hash;
                  return hashes;
                }() +
                "]}"),
        Attack{"TooLong", "POST", "/v1/maps", kJson, std::string(70'000, ' '), 413, "too-large"}),
    name_of);

INSTANTIATE_TEST_SUITE_P(Poses, HostileInput,
                         ::testing::Values(loop("NoRotation", "[0,0,0,0,0,0,0]"),
                                           loop("NotRigid", "[0,0,0,0,0,0,2]"),
                                           loop("TooShort", "[0,0,0,0,0,1]"),
                                           loop("NotFinite", "[0,0,null,0,0,0,1]"),
                                           loop("AlmostInfinite", "[0,0,0,1e200,0,0,1e200]")),
                         name_of);

INSTANTIATE_TEST_SUITE_P(
    Names, HostileInput,
    ::testing::Values(map_name("MapUp", ".."), map_name("MapAbsolute", "/etc"),
                      map_name("MapStaged", ".1"), map_name("MapNul", "a\\u0000b"),
                      map_name("MapLong", std::string(65, 'x')), map_name("MapUpper", "Town"),
                      session("SessionUp", ".."), session("SessionHere", "."),
                      session("SessionSlash", "a/b"), session("SessionNul", "a\\u0000b"),
                      session("SessionLong", std::string(65, 'x')),
                      Attack{"EncodedSlash", "PUT", "/v1/maps/a%2fb/archive", kArchive, "x", 400,
                             "invalid-argument"}),
    name_of);

INSTANTIATE_TEST_SUITE_P(Paths, HostileInput,
                         ::testing::Values(path("Up", ".."), path("UpFromBelow", "drive/../../.."),
                                           path("Absolute", "/etc"), path("Nul", "x\\u0000y"),
                                           path("Long", std::string(5000, 'a')), path("Empty", "")),
                         name_of);

INSTANTIATE_TEST_SUITE_P(
    Scans, HostileInput,
    ::testing::Values(scan("NaN", points(std::nanf(""), 1000), 400, "invalid-argument"),
                      scan("Infinite", points(std::numeric_limits<float>::infinity(), 1000), 400,
                           "invalid-argument"),
                      scan("Denormal", points(std::numeric_limits<float>::denorm_min(), 1000), 400,
                           "invalid-argument"),
                      scan("Absurd", points(3e38f, 1000), 400, "invalid-argument"),
                      scan("Empty", "", 400, "invalid-argument"),
                      scan("Odd", "123", 422, "corrupt-data"),
                      scan(
                          "TooManyPoints", +[] { return points(1, 2'000'001); }, 413, "too-large"),
                      scan(
                          "Bomb", +[] { return zstd(256u << 20); }, 413, "too-large", "zstd"),
                      scan("ClaimsATerabyte",
                           std::string("\x28\xb5\x2f\xfd\xe0\0\0\0\0\0\1\0\0\1\0\0", 16), 413,
                           "too-large", "zstd"),
                      scan("DeclaresNothing", std::string("\x28\xb5\x2f\xfd\0\x58\1\0\0", 9), 422,
                           "corrupt-data", "zstd")),
    name_of);

INSTANTIATE_TEST_SUITE_P(Archives, HostileInput,
                         ::testing::Values(Attack{"Zeros", "PUT", "/v1/maps/new/archive", kArchive,
                                                  std::string(100'000, '\0'), 422, "corrupt-data"},
                                           Attack{"Empty", "PUT", "/v1/maps/new/archive", kArchive,
                                                  "", 422, "corrupt-data"}),
                         name_of);

}  // namespace
}  // namespace cellmap::server::test
