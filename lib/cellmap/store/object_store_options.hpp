#pragma once

#include <chrono>
#include <string>
#include <string_view>

namespace cellmap {

/// Where an S3-compatible service keeps objects for us, and as whom.
struct ObjectStoreOptions {
  std::string place;                 ///< s3://BUCKET[/PREFIX]
  std::string endpoint;              ///< http[s]://HOST[:PORT]; empty: Amazon's of the region
  std::string region = "us-east-1";  ///< signed with; most other services take any
  std::string access_key, secret_key;
  std::string session_token;  ///< of temporary keys; mostly empty
  std::chrono::milliseconds connect_timeout = std::chrono::seconds(3);
  std::chrono::milliseconds timeout = std::chrono::seconds(10);  ///< of one request

  /// The keys as AWS's own programs have them: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY,
  /// AWS_SESSION_TOKEN.
  void take_keys_from_environment();
  /// Throws Error{kInvalidArgument}: no such place or endpoint, keys that are missing.
  void validate() const;

  std::string bucket() const;
  std::string prefix() const;  ///< with its slash at the end, or empty
};

/// Whether an object may be called so: 1 to 200 characters of a-z, 0-9, '-', '_', '.' and '/'.
bool is_object_name(std::string_view name);

}  // namespace cellmap
