#include "server/http/send_answer.hpp"

#include <algorithm>
#include <array>
#include <charconv>

namespace cellmap::server {
namespace {

constexpr std::uint64_t kPieceBytes = 256u << 10;  // of a file that is sent

std::string_view reason_of(int status) {
  struct Row {
    int status;
    std::string_view reason;
  };
  constexpr std::array kTable{
      Row{200, "OK"},
      Row{201, "Created"},
      Row{202, "Accepted"},
      Row{204, "No Content"},
      Row{206, "Partial Content"},
      Row{304, "Not Modified"},
      Row{400, "Bad Request"},
      Row{401, "Unauthorized"},
      Row{403, "Forbidden"},
      Row{404, "Not Found"},
      Row{405, "Method Not Allowed"},
      Row{406, "Not Acceptable"},
      Row{408, "Request Timeout"},
      Row{409, "Conflict"},
      Row{412, "Precondition Failed"},
      Row{413, "Content Too Large"},
      Row{414, "URI Too Long"},
      Row{415, "Unsupported Media Type"},
      Row{416, "Range Not Satisfiable"},
      Row{422, "Unprocessable Content"},
      Row{429, "Too Many Requests"},
      Row{431, "Request Header Fields Too Large"},
      Row{500, "Internal Server Error"},
      Row{501, "Not Implemented"},
      Row{503, "Service Unavailable"},
      Row{505, "HTTP Version Not Supported"},
      Row{507, "Insufficient Storage"},
  };
  const auto* row = std::ranges::find(kTable, status, &Row::status);
  return row == kTable.end() ? std::string_view() : row->reason;
}

bool send_file(Connection& connection, const FileBody& part) {
  for (std::uint64_t sent = 0; sent < part.length;) {
    const Bytes piece =
        part.file->read(part.offset + sent, std::min(part.length - sent, kPieceBytes));
    const std::string_view text(reinterpret_cast<const char*>(piece.data()), piece.size());
    // A file that ends before its length leaves an answer that must not be taken for a whole one.
    if (text.empty() || !connection.write(text)) return false;
    sent += text.size();
  }
  return true;
}

std::string chunk_of(const std::string& piece) {
  std::array<char, 16> size;
  const auto end = std::to_chars(size.data(), size.data() + size.size(), piece.size(), 16).ptr;
  return std::string(size.data(), end).append("\r\n").append(piece).append("\r\n");
}

/// Every piece goes as it comes.
bool send_stream(Connection& connection, const BodyStream& next, bool in_chunks) {
  connection.send_at_once();
  for (bool more = true; more && !connection.is_stopping();) {
    if (connection.is_closed_by_peer()) return false;
    std::string piece;
    more = next(piece);
    if (!piece.empty() && !connection.write(in_chunks ? chunk_of(piece) : piece)) return false;
  }
  return !in_chunks || connection.write("0\r\n\r\n");
}

}  // namespace

std::string answer_head(const Response& response, const AnswerForm& form,
                        const std::optional<std::uint64_t>& length) {
  std::string text;
  text.reserve(response.headers.text().size() + 256);
  text.append("HTTP/1.1 ").append(std::to_string(response.status)).append(" ");
  text.append(reason_of(response.status)).append("\r\n");
  const bool can_have_body = response.status != 204 && response.status != 304;
  text.append(response.headers.text());
  if (can_have_body && !response.headers.get("Content-Type")) {
    text.append("Content-Type: application/octet-stream\r\n");
  }
  if (can_have_body && length) {
    text.append("Content-Length: ").append(std::to_string(*length)).append("\r\n");
  }
  if (!length && !form.is_http_1_0) text.append("Transfer-Encoding: chunked\r\n");
  if (!form.keep) text.append("Connection: close\r\n");
  if (form.keep && form.is_http_1_0) text.append("Connection: keep-alive\r\n");
  return text.append("\r\n");
}

bool send_answer(Connection& connection, const Response& response, AnswerForm form,
                 BodyFiles& files) {
  if (const auto* stream = std::get_if<BodyStream>(&response.body)) {
    form.keep = form.keep && !form.is_http_1_0;  // whose end is that of the connection
    if (!connection.write(answer_head(response, form, std::nullopt))) return false;
    const bool is_whole = form.is_head || send_stream(connection, *stream, !form.is_http_1_0);
    return is_whole && form.keep;
  }
  if (const auto* part = std::get_if<FileBody>(&response.body)) {
    if (!connection.write(answer_head(response, form, part->length))) return false;
    return (form.is_head || send_file(connection, *part)) && form.keep;
  }
  const auto body = body_view(response);
  if (!connection.write(answer_head(response, form, body.size()))) return false;
  if (form.is_head) return form.keep;
  if (const auto* shared = std::get_if<SharedBytes>(&response.body)) {
    if (const auto file = files.find(shared->bytes)) {
      return connection.write_of_file(body, file->value(), shared->offset) && form.keep;
    }
  }
  return connection.write(body) && form.keep;
}

}  // namespace cellmap::server
