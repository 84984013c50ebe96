#include "cellmap/store/documents.hpp"

#include "cellmap/core/error.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

Documents& documents_of(Store& store) {
  if (auto* documents = dynamic_cast<Documents*>(&store)) return *documents;
  throw Error(ErrorCode::kUnsupported, "this store keeps no documents beside its maps");
}

}  // namespace cellmap
