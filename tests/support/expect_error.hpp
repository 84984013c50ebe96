#pragma once

#include <gmock/gmock.h>

#include <initializer_list>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap::test {

/// Expects that `act` throws a cellmap::Error of `code` whose message contains all of `parts`.
template <typename Act, typename... Parts>
void expect_error(ErrorCode code, const Act& act, const Parts&... parts) {
  try {
    act();
  } catch (const Error& error) {
    EXPECT_EQ(to_string(error.code()), to_string(code)) << error.what();
    for (const std::string& part : std::initializer_list<std::string>{std::string(parts)...}) {
      EXPECT_THAT(std::string(error.what()), ::testing::HasSubstr(part));
    }
    return;
  }
  ADD_FAILURE() << "expected an Error of the code " << to_string(code) << ", nothing was thrown";
}

}  // namespace cellmap::test
