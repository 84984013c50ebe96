#include "cellmap/core/hash.hpp"

#include <gtest/gtest.h>

#include <string_view>

#include "cellmap/core/error.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

std::string sha256_hex(std::string_view text) {
  return to_hex(sha256(std::as_bytes(std::span(text))));
}

TEST(Sha256, AgreesWithTheVectorsOfFips180) {
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256_hex(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256_hex("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
}

TEST(Sha256, OfPiecesIsThatOfTheirConcatenation) {
  const auto bytes = [](std::string_view text) { return std::as_bytes(std::span(text)); };
  EXPECT_EQ(sha256_of_pieces({bytes("a"), {}, bytes("bc")}), sha256(bytes("abc")));
}

TEST(ContentHashes, AreReadBackFromTheirDigits) {
  const ContentHash hash = sha256({});
  EXPECT_EQ(content_hash_from_hex(to_hex(hash)), hash);
}

TEST(ContentHashes, AnythingButSixtyFourDigitsIsRefused) {
  const std::string zeros(64, '0');
  const auto refuse = [](const std::string& hex) {
    test::expect_error(
        ErrorCode::kInvalidArgument, [&] { content_hash_from_hex(hex); }, "64 hexadecimal digits");
  };
  refuse("");
  refuse(zeros.substr(1));
  refuse(zeros + "0");
  refuse("g" + zeros.substr(1));
  refuse("-1" + zeros.substr(2));
  refuse("0x" + zeros.substr(2));
  refuse(zeros.substr(2) + " 1");
}

}  // namespace
}  // namespace cellmap
