#pragma once

#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {

/// An Error{kIo} of which it is known that it is over once there is room on the disk again: nothing
/// is wrong with the disk, the request or the data. For who tells the two apart, as the API does
/// (507 instead of 500); everybody else catches Error.
class DiskFull : public Error {
 public:
  explicit DiskFull(const std::string& message) : Error(ErrorCode::kIo, message) {}
};

}  // namespace cellmap
