#include "server/api/failure.hpp"

#include "server/api/problem.hpp"

namespace cellmap::server {

Response problem_of(const std::exception_ptr& failure, const std::string& request_id) {
  const std::string see_log = "The server failed; its log names the request '" + request_id + "'.";
  try {
    std::rethrow_exception(failure);
  } catch (const Error& error) {
    if (error.code() == ErrorCode::kDiskFull) {  // its message may hold a path of the server
      return problem(
          error.code(),
          "The server's disk is full; nothing was changed. Try again when there is room.");
    }
    return status_of(error.code()) == 500 ? problem(error.code(), see_log) : problem(error);
  } catch (const std::exception&) {
    return problem(ErrorCode::kInternal, see_log);
  }
}

}  // namespace cellmap::server
