#include "server/auth/token_file.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <fstream>
#include <iterator>
#include <random>

#include "cellmap/core/error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::auth {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// Of "abc" (FIPS 180-2, appendix B.1) and of "".
const std::string kAbc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
const std::string kEmpty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

std::string refusal(const std::string& text) {
  try {
    parse_tokens(text, "tokens");
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::kInvalidArgument);
    return error.what();
  }
  return "";
}

TEST(TokenFile, SaysWhoMayDoWhat) {
  const auto tokens = parse_tokens("# fleet\n\ncart-7  sha256:" + kAbc +
                                       " map:read,map:write maps=town,harbour "
                                       "expires=2027-01-31T12:00:00Z rate=2.5 # old\r\n"
                                       "root sha256:" +
                                       kEmpty + "\tadmin",
                                   "tokens");
  ASSERT_EQ(tokens.size(), 2u);
  EXPECT_EQ(tokens[0].name, "cart-7");
  EXPECT_EQ(tokens[0].hash, hash_of_secret("abc"));
  EXPECT_THAT(tokens[0].scopes, ElementsAre(Scope::kMapRead, Scope::kMapWrite));
  EXPECT_THAT(tokens[0].maps, ElementsAre("harbour", "town"));
  // date -u -d 2027-01-31T12:00:00Z +%s
  EXPECT_EQ(tokens[0].expires->time_since_epoch().count(), 1801396800);
  EXPECT_EQ(tokens[0].requests_per_s, 2.5);
  EXPECT_TRUE(tokens[1].maps.empty());
  EXPECT_FALSE(tokens[1].expires);
}

TEST(TokenFile, WhatIsWrittenIsReadAgain) {
  Token token{"a.b_c-9", hash_of_secret("x"), {Scope::kRelocalise, Scope::kAdmin}, {"m"}, {}, 0.1};
  token.expires = time_from_text("2031-02-28");
  EXPECT_THAT(parse_tokens(to_line(token), "f"), ElementsAre(token));
  const Token plain{"b", hash_of_secret("y"), {Scope::kMapRead}, {}, {}, {}};
  EXPECT_THAT(parse_tokens(to_line(token) + to_line(plain), "f"), ElementsAre(token, plain));
}

TEST(TokenFile, WhatItDoesNotKnowIsRefusedWithItsLine) {
  const std::string good = "a sha256:" + kAbc + " map:read";
  EXPECT_EQ(refusal(good), "");
  const std::vector<std::pair<std::string, std::string>> wrong{
      {"a sha256:" + kAbc, "fewer words"},
      {"a sha256:" + kAbc.substr(1) + " admin", "64 hexadecimal digits"},
      {"a " + kAbc + " admin", "64 hexadecimal digits"},
      {"a sha256:" + kAbc + " map:delete", "no scope 'map:delete'"},
      {"a sha256:" + kAbc + " ,", "at least one scope"},
      {"a/b sha256:" + kAbc + " admin", "a name of"},
      {std::string(65, 'a') + " sha256:" + kAbc + " admin", "a name of"},
      {good + " maps=", "KEY=VALUE"},
      {good + " maps=,", "names of maps"},
      {good + " colour=red", "found 'colour=red'"},
      {good + " rate=1 rate=2", "each once"},
      {good + " rate=-1", "requests a second"},
      {good + " rate=nan", "requests a second"},
      {good + " rate=1e999", "requests a second"},
      {good + " rate=5x", "requests a second"},
      {good + " expires=tomorrow", "expected a time"},
      {good + " expires=2027-02-29", "expected a time"},
      {good + " expires=2027-01-01T24:00:00Z", "expected a time"},
      {good + " expires=2027-01-01T00:00:00+01:00", "expected a time"},
  };
  for (const auto& [line, why] : wrong) {
    const auto message = refusal("# first\n" + line + "\n");
    EXPECT_THAT(message, StartsWith("tokens:2: ")) << line;
    EXPECT_THAT(message, HasSubstr(why)) << line;
  }
}

TEST(TokenFile, ASecretThatStandsInItByMistakeIsNotRepeated) {
  const std::string secret = make_secret();
  EXPECT_EQ(refusal("a " + secret + " admin").find(secret), std::string::npos);
}

TEST(TokenFile, NamesAndSecretsComeOnce) {
  const std::string a = "a sha256:" + kAbc + " admin\n";
  EXPECT_THAT(refusal(a + "a sha256:" + kEmpty + " admin"), StartsWith("tokens:2: the name a"));
  EXPECT_THAT(refusal(a + "b sha256:" + kAbc + " admin"), StartsWith("tokens:2: the secret of a"));
}

TEST(TokenFile, HasNoMoreTokensThanAServerLooksThrough) {
  std::string text;
  for (std::size_t i = 0; i <= kMaxTokens; ++i) {
    const auto name = std::to_string(i);
    text += to_line({name, hash_of_secret(name), {Scope::kMapRead}, {}, {}, {}});
  }
  EXPECT_THAT(refusal(text), HasSubstr("more than 1000 tokens"));
}

TEST(TokenFile, AnyBytesAreReadOrRefused) {
  std::mt19937 random(3);
  const std::string good = "a sha256:" + kAbc + " map:read maps=b expires=2027-01-31 rate=2\n";
  for (int i = 0; i < 20'000; ++i) {
    std::string text = good;
    for (int k = 0; k < 3; ++k) text[random() % text.size()] = static_cast<char>(random());
    refusal(text);
  }
}

class Files : public ::testing::Test {
 protected:
  std::string text() const {
    std::ifstream input(file_);
    return {std::istreambuf_iterator<char>(input), {}};
  }
  unsigned mode() const {
    struct stat status {};
    ::stat(file_.c_str(), &status);
    return status.st_mode & 0777;
  }
  test::TempFolder folder_;
  const std::filesystem::path file_ = folder_ / "tokens";
  const Token a_{"a", hash_of_secret("x"), {Scope::kMapRead}, {}, {}, {}};
  const Token b_{"b", hash_of_secret("y"), {Scope::kAdmin}, {}, {}, {}};
};

TEST_F(Files, AreMadeForTheirOwnerOnlyAndKeepTheirComments) {
  add_token(file_, a_);
  EXPECT_EQ(mode(), 0600u);
  std::ofstream(file_, std::ios::app) << "# of the workshop\n";
  add_token(file_, b_);
  EXPECT_THAT(read_token_file(file_), ElementsAre(a_, b_));
  remove_token(file_, "a");
  EXPECT_EQ(text(), "# of the workshop\n" + to_line(b_));
  EXPECT_EQ(mode(), 0600u);
}

TEST_F(Files, ATakenNameAndAMissingOneAreErrors) {
  add_token(file_, a_);
  EXPECT_THROW(add_token(file_, a_), Error);
  EXPECT_THROW(remove_token(file_, "b"), Error);
  EXPECT_THAT(read_token_file(file_), ElementsAre(a_));
}

TEST_F(Files, ThatOthersMayReadAreRefused) {
  add_token(file_, a_);
  ::chmod(file_.c_str(), 0640);
  try {
    read_token_file(file_);
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("chmod 600"));
  }
  EXPECT_THROW(add_token(file_, b_), Error);
  ::chmod(file_.c_str(), 0400);
  EXPECT_EQ(read_token_file(file_).size(), 1u);
}

TEST_F(Files, AreFilesAndBounded) {
  EXPECT_THROW(read_token_file(folder_.path()), Error);
  EXPECT_THROW(read_token_file(file_), Error);
  std::ofstream(file_) << std::string(kMaxTokenFileBytes + 1, '\n');
  ::chmod(file_.c_str(), 0600);
  EXPECT_THROW(read_token_file(file_), Error);
}

TEST(Token, SecretsAreLongAndNeverTheSame) {
  const auto a = make_secret(), b = make_secret();
  EXPECT_NE(a, b);
  EXPECT_EQ(a.size(), 8 + 43u);  // 256 bits of base64
  EXPECT_TRUE(is_secret(a));
}

}  // namespace
}  // namespace cellmap::auth
