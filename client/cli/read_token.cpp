#include "client/cli/read_token.hpp"

#include <cstdlib>
#include <fstream>

#include "cellmap/core/error.hpp"

namespace cellmap::cli {

std::string read_token(const std::string& file) {
  if (file.empty()) {
    const char* token = std::getenv("CELLMAP_TOKEN");
    return token ? token : "";
  }
  std::ifstream input(file);
  std::string token, more;
  if (!input) throw Error(ErrorCode::kNotFound, "cannot read the token file '" + file + "'");
  if (!(input >> token) || token.size() > 128 || (input >> more)) {
    throw Error(ErrorCode::kInvalidArgument,
                "'" + file + "' should hold one token, as 'cellmap token create' printed it");
  }
  return token;
}

}  // namespace cellmap::cli
