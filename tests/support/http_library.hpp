#pragma once

// The HTTP library's header brings resolv.h and its macro `_res`, a name that Eigen uses: Eigen
// first.
// clang-format off
#include "cellmap/geometry/pose.hpp"
#include <httplib.h>
// clang-format on
