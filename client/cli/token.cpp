#include <CLI/CLI.hpp>
#include <charconv>
#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/core/error.hpp"
#include "cellmap/store/store.hpp"
#include "client/cli/command_line.hpp"
#include "server/auth/token_file.hpp"

namespace cellmap::cli {
namespace {

using auth::Time;
using auth::Token;

struct TokenArguments {
  std::string file, name, expires;
  std::vector<std::string> scopes, maps;
  std::optional<double> rate;
};

Time now() { return std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now()); }

/// "90d", "12h", or a time.
Time read_expiry(const std::string& text) {
  long count = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), count);
  const std::string unit(end, text.data() + text.size());
  if (error == std::errc() && count > 0 && count <= 36'500) {
    if (unit == "d") return now() + std::chrono::days(count);
    if (unit == "h") return now() + std::chrono::hours(count);
  }
  const auto time = auth::time_from_text(text);
  if (time && *time > now()) return *time;
  throw Error(ErrorCode::kInvalidArgument,
              "--expires: expected days or hours such as 90d or 12h, or a time to come such as "
              "2027-01-31 or 2027-01-31T12:00:00Z, found '" +
                  text + "'");
}

Token read_token(const TokenArguments& options, const std::string& secret) {
  Token token;
  token.name = options.name;
  if (!auth::is_token_name(token.name)) {
    throw Error(ErrorCode::kInvalidArgument,
                "a token's name has 1 to 64 letters, digits, '.', '_' or '-'");
  }
  token.hash = auth::hash_of_secret(secret);
  for (const auto& text : options.scopes) token.scopes.insert(*auth::scope_from_string(text));
  for (const auto& map : options.maps) validate_map_name(map);
  token.maps = {options.maps.begin(), options.maps.end()};
  if (!options.expires.empty()) token.expires = read_expiry(options.expires);
  token.requests_per_s = options.rate;
  return token;
}

client::Json to_json(const Token& token) {
  client::Json json{{"name", token.name}, {"scopes", client::Json::array()}};
  for (const auto scope : token.scopes) json["scopes"].push_back(to_string(scope));
  json["maps"] = nullptr;
  if (!token.maps.empty()) json["maps"] = token.maps;
  json["expires"] = nullptr;
  if (token.expires) json["expires"] = auth::to_text(*token.expires);
  json["expired"] = token.is_expired(now());
  if (token.requests_per_s) json["rate"] = *token.requests_per_s;
  return json;
}

/// Without its hash.
std::string line_of(const Token& token) {
  std::string line = auth::to_line(token);
  const auto hash = line.find(" sha256:");
  line.erase(hash, line.find(' ', hash + 1) - hash);
  if (token.is_expired(now())) line.insert(line.size() - 1, "  (expired)");
  return line;
}

void create_token(const TokenArguments& options, const Console& console) {
  const std::string secret = auth::make_secret();
  const Token token = read_token(options, secret);
  auth::add_token(options.file, token);
  client::Json json = to_json(token);
  json["token"] = secret;
  console.print(json, secret + "\n");
}

void list_tokens(const TokenArguments& options, const Console& console) {
  client::Json json = client::Json::array();
  std::string text;
  for (const Token& token : auth::read_token_file(options.file)) {
    json.push_back(to_json(token));
    text += line_of(token);
  }
  console.print({{"tokens", json}}, text.empty() ? "No tokens.\n" : text);
}

void revoke(const TokenArguments& options, const Console& console) {
  auth::remove_token(options.file, options.name);
  console.print({{"revoked", options.name}},
                "Revoked. A running cellmapd forgets it at: systemctl reload cellmapd (SIGHUP)\n");
}

void add_file_option(CLI::App& verb, TokenArguments& options) {
  verb.add_option("--tokens", options.file, "The file that cellmapd --tokens reads")
      ->envname("CELLMAPD_TOKENS")
      ->required();
}

}  // namespace

void add_token(CLI::App& app, Verbs& verbs) {
  CLI::App* group =
      app.add_subcommand("token", "Make, list and revoke tokens: who may do what on a server");
  group->require_subcommand(1);

  const auto made = std::make_shared<TokenArguments>();
  CLI::App* verb = verbs.add(
      *group, "create", "Make a token and print it, this once; the file keeps its SHA-256",
      "  cellmap token create cart-7 --tokens tokens --scope map:read,map:write --expires 90d\n"
      "  cellmap token create guest --tokens tokens --scope relocalise --maps town --rate 2\n"
      "A running cellmapd learns of it at: systemctl reload cellmapd (SIGHUP)\n",
      [made](const Console& console) { create_token(*made, console); });
  verb->add_option("NAME", made->name, "Of its owner; logs say it")->required();
  add_file_option(*verb, *made);
  verb->add_option("--scope", made->scopes, "map:read, map:write, relocalise, admin")
      ->delimiter(',')
      ->required()
      ->check(CLI::IsMember({"map:read", "map:write", "relocalise", "admin"}));
  verb->add_option("--maps", made->maps, "The only maps it is good for (default: all)")
      ->delimiter(',');
  verb->add_option("--expires", made->expires, "90d, 12h or a time (default: never)");
  verb->add_option("--rate", made->rate, "Requests a second, instead of the server's limit")
      ->check(CLI::Range(0.0, 1e6));

  const auto listed = std::make_shared<TokenArguments>();
  verb = verbs.add(*group, "list", "The tokens of a file, without their secrets",
                   "  cellmap token list --tokens tokens\n",
                   [listed](const Console& console) { list_tokens(*listed, console); });
  add_file_option(*verb, *listed);

  const auto revoked = std::make_shared<TokenArguments>();
  verb = verbs.add(*group, "revoke", "Take a token out of a file",
                   "  cellmap token revoke cart-7 --tokens tokens\n",
                   [revoked](const Console& console) { revoke(*revoked, console); });
  verb->add_option("NAME", revoked->name, "Of the token")->required();
  add_file_option(*verb, *revoked);
}

}  // namespace cellmap::cli
