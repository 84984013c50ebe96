#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "server/auth/token.hpp"

/// The file of those who may ask a server: one token a line,
///
///     # anything after a hash
///     cart-7  sha256:<64 hexadecimal digits>  map:read,map:write  maps=town,harbour
///             ^ of the secret                 ^ scopes            ^ only these; without it all
///
/// and further, in any order, `expires=2027-01-31T00:00:00Z` and `rate=20` (requests a second, 0:
/// no limit). All of a token stands on its line. Only its owner may read the file (mode 0600).
namespace cellmap::auth {

inline constexpr std::size_t kMaxTokens = 1000;
inline constexpr std::size_t kMaxTokenFileBytes = 1u << 20;

/// Throws Error{kInvalidArgument} that begins with "FILE:LINE: " for what it does not know, a name
/// or secret that comes twice, and more than `kMaxTokens`. `file` is for messages.
std::vector<Token> parse_tokens(std::string_view text, const std::string& file);
/// One line, as `parse_tokens` reads it.
std::string to_line(const Token& token);

/// Throws as `parse_tokens`; Error{kNotFound} where there is no file, Error{kInvalidArgument} where
/// others than its owner may read or write it, or its owner is somebody else (root may be).
std::vector<Token> read_token_file(const std::filesystem::path& file);

/// Adds a token to the file, which is made where it is missing. Error{kAlreadyExists} where the
/// name is taken. The file is replaced as a whole, keeps its owner and what else stands in it; one
/// that root makes belongs to the owner of its folder.
void add_token(const std::filesystem::path& file, const Token& token);
/// Error{kNotFound} where there is no token of this name.
void remove_token(const std::filesystem::path& file, const std::string& name);

}  // namespace cellmap::auth
