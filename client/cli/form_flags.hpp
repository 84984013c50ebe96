#pragma once

#include <optional>
#include <string>

#include "cellmap/codec/cell_form.hpp"

namespace CLI {
class App;
}

namespace cellmap::cli {

/// --encoding and --bound as they were given.
struct FormFlags {
  std::string encoding, bound;

  /// nullopt where neither was given. --bound is a length as "20mm", "0.02m" or "2cm". Throws
  /// Error{kInvalidArgument}.
  std::optional<CellForm> form() const;
};

/// Declares both. `what` says what is encoded and what happens without --encoding.
void add_form_flags(CLI::App& verb, FormFlags& flags, const std::string& what);

}  // namespace cellmap::cli
