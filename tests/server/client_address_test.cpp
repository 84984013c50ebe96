#include "server/http/client_address.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace cellmap::server {
namespace {

TEST(AddressName, IsTheAddressOrTheNetworkOfAnIPv6One) {
  EXPECT_EQ(address_name("203.0.113.9"), "203.0.113.9");
  EXPECT_EQ(address_name("2001:db8:1:2:3:4:5:6"), "2001:db8:1:2::/64");
  EXPECT_EQ(address_name("::ffff:203.0.113.9"), "203.0.113.9");
  for (const char* const none : {"", "203.0.113.9:80", "[::1]", "unknown", "1.2.3", "::1/64"}) {
    EXPECT_EQ(address_name(none), std::nullopt) << none;
  }
}

class ClientAddress : public testing::Test {
 protected:
  std::string from(const std::string& peer, const std::string& forwarded_for) const {
    return client_address(peer, forwarded_for, trusted_);
  }

  std::vector<std::string> trusted_{"127.0.0.1", "10.0.0.1", "unix"};
};

TEST_F(ClientAddress, IsThePeersWithoutATrustedProxy) {
  EXPECT_EQ(from("198.51.100.7", "203.0.113.9"), "198.51.100.7");
  trusted_.clear();
  EXPECT_EQ(from("127.0.0.1", "203.0.113.9"), "127.0.0.1");
}

TEST_F(ClientAddress, IsWhomTheFarthestTrustedProxyWasAskedBy) {
  EXPECT_EQ(from("127.0.0.1", "203.0.113.9"), "203.0.113.9");
  EXPECT_EQ(from("unix", "203.0.113.9"), "203.0.113.9");
  EXPECT_EQ(from("127.0.0.1", "203.0.113.9, 10.0.0.1"), "203.0.113.9");
}

TEST_F(ClientAddress, IsNotWhatAClientInvents) {
  EXPECT_EQ(from("127.0.0.1", "192.0.2.1, 203.0.113.9"), "203.0.113.9");
  EXPECT_EQ(from("127.0.0.1", "10.0.0.1, 203.0.113.9, 10.0.0.1"), "203.0.113.9");
}

TEST_F(ClientAddress, IsTheNearestProxysWhereThatSaysNothing) {
  EXPECT_EQ(client_address("127.0.0.1", std::nullopt, trusted_), "127.0.0.1");
  EXPECT_EQ(from("127.0.0.1", "not an address"), "127.0.0.1");
  EXPECT_EQ(from("127.0.0.1", "203.0.113.9, unknown, 10.0.0.1"), "10.0.0.1");
}

}  // namespace
}  // namespace cellmap::server
