#include "server/http/client_address.hpp"

#include <arpa/inet.h>

#include <algorithm>

#include "server/api/text.hpp"

namespace cellmap::server {

std::optional<std::string> address_name(std::string_view text) {
  const std::string terminated(text);
  char name[INET6_ADDRSTRLEN];
  in_addr v4{};
  if (::inet_pton(AF_INET, terminated.c_str(), &v4) == 1) return terminated;
  in6_addr network{};
  if (::inet_pton(AF_INET6, terminated.c_str(), &network) != 1) return std::nullopt;
  if (IN6_IS_ADDR_V4MAPPED(&network)) {
    return ::inet_ntop(AF_INET, network.s6_addr + 12, name, sizeof(name));
  }
  std::fill_n(network.s6_addr + 8, 8, std::uint8_t{0});
  return std::string(::inet_ntop(AF_INET6, &network, name, sizeof(name))) + "/64";
}

std::string client_address(const std::string& peer, std::optional<std::string_view> forwarded_for,
                           std::span<const std::string> trusted) {
  const auto is_trusted = [&](const std::string& address) {
    return std::ranges::find(trusted, address) != trusted.end();
  };
  std::string nearest = peer;
  const auto hops = split(forwarded_for.value_or(""), ',');
  // Not std::views::reverse, which clang 14 cannot compile.
  for (auto hop = hops.rbegin(); hop != hops.rend(); ++hop) {
    if (!is_trusted(nearest)) break;
    const auto address = address_name(*hop);
    if (!address) break;
    nearest = *address;
  }
  return nearest;
}

}  // namespace cellmap::server
