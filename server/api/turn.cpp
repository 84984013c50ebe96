#include "server/api/turn.hpp"

#include "cellmap/core/background.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap::server {
namespace {

/// Beyond those that run. More would only hold memory and workers, and be told so later.
constexpr int kMostWaiting = 32;

class Turn {
 public:
  explicit Turn(Services& services) : services_(services), before_(services.turns++) {
    const ApiOptions& options = services.options;
    if (before_ >= options.relocalisations + kMostWaiting ||
        !services.relocalisations.try_acquire_for(options.relocalisation_wait)) {
      --services.turns;
      throw Error(ErrorCode::kUnavailable,
                  "Too many relocalisations and comparisons at a time; try again.");
    }
  }
  ~Turn() {
    --services_.turns;
    services_.relocalisations.release();
  }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;

  bool is_alone() const { return before_ == 0; }

 private:
  Services& services_;
  const int before_;  ///< that ran or waited when it came
};

}  // namespace

void in_turn(Services& services, const std::function<void(int threads)>& work) {
  const Turn turn(services);
  run_in_background([&] { work(turn.is_alone() ? services.options.threads : 1); });
}

}  // namespace cellmap::server
