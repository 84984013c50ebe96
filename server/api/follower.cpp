#include "server/api/follower.hpp"

#include "cellmap/core/error.hpp"

namespace cellmap::server {

Follower::Follower(Services& services) : services_(services) {
  const int count = ++services_.followers;
  if (count > services_.options.max_followers) {
    --services_.followers;
    throw Error(ErrorCode::kUnavailable,
                "Too many clients follow jobs and maps; ask without waiting instead.");
  }
  services_.metrics.set_followers(count);
}

Follower::~Follower() { services_.metrics.set_followers(--services_.followers); }

}  // namespace cellmap::server
