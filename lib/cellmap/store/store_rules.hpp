#pragma once

#include <string>
#include <vector>

#include "cellmap/store/check_store.hpp"

namespace cellmap {

/// What the rows of a store must keep to beyond what SQLite sees to itself.
struct StoreRule {
  StoreDamage damage;
  const char* what;  ///< is said of what `find` finds
  /// SQL: key of a map or NULL, id of a CELL or NULL, text or NULL; no row where the rule holds.
  std::string find;
  std::string mend;  ///< SQL after which it holds; empty where it takes more than SQL
  const char* lost;  ///< what mending loses, with the number of rows; null: nothing
};

/// In the order in which they are to be mended: later ones mend what earlier ones leave.
std::vector<StoreRule> store_rules();

}  // namespace cellmap
