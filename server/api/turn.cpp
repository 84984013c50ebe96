#include "server/api/turn.hpp"

#include <string>

#include "cellmap/core/background.hpp"
#include "cellmap/core/error.hpp"
#include "server/api/api.hpp"

namespace cellmap::server {
namespace {

/// Beyond those that run. More would only hold memory and workers, and be told so later.
constexpr int kMostWaiting = 32;

class Turn {
 public:
  explicit Turn(Turns& turns) : turns_(turns), before_(turns.taken++) {
    if (before_ >= turns.at_a_time + kMostWaiting || !turns.free.try_acquire_for(turns.wait)) {
      --turns.taken;
      throw Error(ErrorCode::kUnavailable,
                  "Too many " + std::string(turns.what) + " at a time; try again.");
    }
  }
  ~Turn() {
    --turns_.taken;
    turns_.free.release();
  }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;

  bool is_alone() const { return before_ == 0; }

 private:
  Turns& turns_;
  const int before_;  ///< that ran or waited when it came
};

}  // namespace

void in_turn(Turns& turns, int threads, const std::function<void(const Effort&)>& work) {
  const Turn turn(turns);
  run_in_background([&](const GiveWay& give_way) {
    work({turn.is_alone() ? threads : 1, give_way});
  });
}

void in_turn(Services& services, const std::function<void(const Effort&)>& work) {
  in_turn(services.turns, services.options.threads, work);
}

}  // namespace cellmap::server
