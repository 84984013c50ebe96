#include "cellmap/core/progress.hpp"

#include <gtest/gtest.h>

#include "support/expect_error.hpp"

namespace cellmap {
namespace {

TEST(Stops, ThrowCancelledOnlyOnceRequested) {
  std::stop_source source;
  EXPECT_NO_THROW(throw_if_stopped(source.get_token()));
  source.request_stop();
  test::expect_error(ErrorCode::kCancelled, [&] { throw_if_stopped(source.get_token()); });
}

TEST(Stops, NeverComeFromATokenWithoutASource) {
  EXPECT_NO_THROW(throw_if_stopped(std::stop_token()));
}

}  // namespace
}  // namespace cellmap
