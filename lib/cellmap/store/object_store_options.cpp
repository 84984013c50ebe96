#include "cellmap/store/object_store_options.hpp"

#include <algorithm>
#include <cstdlib>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::string_view kScheme = "s3://";

bool is_of(std::string_view text, std::string_view others) {
  return std::ranges::all_of(text, [&](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || others.find(c) != others.npos;
  });
}

std::string environment(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

bool is_object_name(std::string_view name) {
  return !name.empty() && name.size() <= 200 && is_of(name, "-_./");
}

std::string ObjectStoreOptions::bucket() const {
  const std::string rest = place.substr(kScheme.size());
  return rest.substr(0, rest.find('/'));
}

std::string ObjectStoreOptions::prefix() const {
  const std::string rest = place.substr(kScheme.size());
  const auto slash = rest.find('/');
  std::string prefix = slash == rest.npos ? "" : rest.substr(slash + 1);
  if (!prefix.empty() && prefix.back() != '/') prefix += '/';
  return prefix;
}

void ObjectStoreOptions::take_keys_from_environment() {
  access_key = environment("AWS_ACCESS_KEY_ID");
  secret_key = environment("AWS_SECRET_ACCESS_KEY");
  session_token = environment("AWS_SESSION_TOKEN");
}

void ObjectStoreOptions::validate() const {
  const auto refuse = [](const std::string& why) { throw Error(ErrorCode::kInvalidArgument, why); };
  if (!place.starts_with(kScheme) || bucket().size() < 3 || bucket().size() > 63 ||
      !is_of(bucket(), "-.") || !(prefix().empty() || is_object_name(prefix()))) {
    refuse(
        "blobs: expected s3://BUCKET or s3://BUCKET/PREFIX, of a-z, 0-9, '-', '.', and in the "
        "prefix '_' and '/'");
  }
  if (!endpoint.empty() && !endpoint.starts_with("http://") && !endpoint.starts_with("https://")) {
    refuse("blobs: expected an endpoint like https://s3.example.org");
  }
  if (region.empty() || !is_of(region, "-")) refuse("blobs: expected a region like eu-central-1");
  if (access_key.empty() || secret_key.empty()) {
    refuse("blobs: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY in the environment");
  }
  // A header of ours holds it.
  if (session_token.find_first_of("\r\n") != std::string::npos) {
    refuse("blobs: AWS_SESSION_TOKEN has a line end");
  }
  if (connect_timeout.count() < 1 || timeout.count() < 1) refuse("blobs: expected times above 0");
}

}  // namespace cellmap
