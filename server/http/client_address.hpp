#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace cellmap::server {

/// How limits and the audit log write an IP address, out of its usual text without a port: IPv4 as
/// it is, IPv6 as its network ("2001:db8::/64", of which a client has all). Nullopt for anything
/// else.
std::optional<std::string> address_name(std::string_view text);

/// Where a request comes from: `peer`, or where that is one of the trusted proxies, the last
/// address of X-Forwarded-For that is none of them, because each proxy adds whom it was asked by
/// and what stands before the first trusted one's word may be invented. Where that is no address,
/// the nearest proxy. `peer` and `trusted` as `address_name` has them, or "unix".
std::string client_address(const std::string& peer, std::optional<std::string_view> forwarded_for,
                           std::span<const std::string> trusted);

}  // namespace cellmap::server
