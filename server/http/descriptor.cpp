#include "server/http/descriptor.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap::server {

Descriptor::Descriptor(int value) : value_(value) {
  if (value < 0) throw Error(ErrorCode::kIo, std::string("descriptor: ") + std::strerror(errno));
}
Descriptor::~Descriptor() { ::close(value_); }

}  // namespace cellmap::server
