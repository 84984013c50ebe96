#include "cellmap/store/claims.hpp"

#include "cellmap/core/error.hpp"

namespace cellmap {

Claims& claims_of(Store& store) {
  if (auto* claims = dynamic_cast<Claims*>(&store)) return *claims;
  throw Error(ErrorCode::kUnsupported, "this store shares no jobs among workers");
}

}  // namespace cellmap
