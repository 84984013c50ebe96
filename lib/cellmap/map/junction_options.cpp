#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/map/junction.hpp"

namespace cellmap {
namespace {

void check_junction(bool holds, const char* rule) {
  if (!holds) throw Error(ErrorCode::kInvalidArgument, std::string("a junction needs ") + rule);
}

}  // namespace

void JunctionOptions::validate() const {
  relocalise.validate();
  confirm.validate();
  check_junction(confirmations <= neighbours, "confirmations <= neighbours");
  check_junction(neighbours <= 1000, "neighbours <= 1000");
  check_junction(max_distance_m > 0 && max_distance_m <= 1000, "0 < max_distance_m <= 1000");
  check_junction(max_difference_m > 0, "max_difference_m > 0");
  check_junction(max_difference_deg > 0, "max_difference_deg > 0");
}

}  // namespace cellmap
