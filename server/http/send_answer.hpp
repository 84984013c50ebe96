#pragma once

#include <optional>
#include <string>

#include "server/api/message.hpp"
#include "server/http/body_files.hpp"
#include "server/http/connection.hpp"

namespace cellmap::server {

/// What the request asks of its answer besides what the API says.
struct AnswerForm {
  bool is_head = false;      ///< no body, only what would be said of it
  bool is_http_1_0 = false;  ///< whose clients know no chunks
  bool keep = true;          ///< the connection can take another request
};

/// Status line and fields, the empty line included. `length`: of the body; nullopt: not known.
std::string answer_head(const Response& response, const AnswerForm& form,
                        const std::optional<std::uint64_t>& length);

/// Sends an answer: bytes with their head, without copying them (out of `files` where they are sent
/// again and again), files in pieces, streams in chunks until they end, the peer leaves or the
/// server stops. True where the connection can take another request. Throws what reading a file
/// throws; half of an answer is sent then.
bool send_answer(Connection& connection, const Response& response, AnswerForm form,
                 BodyFiles& files);

}  // namespace cellmap::server
