#include "cellmap/client/transport.hpp"

#include <httplib.h>

#include <algorithm>
#include <cctype>
#include <exception>

#include "cellmap/client/files.hpp"
#include "cellmap/client/json.hpp"
#include "cellmap/codec/zstd.hpp"

namespace cellmap::client {
namespace {

std::string lower_case(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

std::unique_ptr<httplib::Client> connect(const ServerUrl& url, const ClientOptions& options) {
  ServerUrl origin = url;
  origin.path_prefix.clear();
  auto http = std::make_unique<httplib::Client>(to_string(origin));
  if (!http->is_valid()) {
    throw Error(ErrorCode::kInvalidArgument, "cannot use the server address " + to_string(url));
  }
  http->set_keep_alive(true);
  http->set_tcp_nodelay(true);
  http->set_url_encode(false);  // paths arrive here encoded
  http->set_decompress(false);  // only zstd is asked for, and decompressed with a bound
  http->set_connection_timeout(options.connect_timeout);
  http->set_read_timeout(options.read_timeout);
  http->set_write_timeout(options.write_timeout);
  return http;
}

bool never_reached_the_server(httplib::Error error) {
  return error == httplib::Error::Connection || error == httplib::Error::BindIPAddress ||
         error == httplib::Error::SSLConnection || error == httplib::Error::ConnectionTimeout;
}

std::string bearer(const ClientOptions& options) { return "Bearer " + options.token; }

bool refused_unprocessed(int status) { return status == 503 || status == 429; }
bool gateway_failed(int status) { return status == 502 || status == 504; }

Error connection_error(httplib::Error error, const HttpRequest& request, const ServerUrl& url) {
  if (never_reached_the_server(error)) {
    return Error(ErrorCode::kUnavailable,
                 "cannot reach the server at " + to_string(url) +
                     ": nothing accepts connections there; check the address, or start one with "
                     "'cellmap serve --store FILE --listen HOST:PORT'");
  }
  return Error(ErrorCode::kIo, "the connection to " + to_string(url) + " broke during " +
                                   request.method + " " + request.path + " (" +
                                   httplib::to_string(error) +
                                   "); check that the server still runs, then try again");
}

}  // namespace

std::string HttpResponse::header(const std::string& lower_case_name) const {
  const auto found = headers.find(lower_case_name);
  return found == headers.end() ? "" : found->second;
}

struct Transport::Impl {
  std::unique_ptr<httplib::Client> http;
};

struct Transport::Attempt {
  httplib::Error error = httplib::Error::Success;
  bool too_large = false;
  bool no_body = false;  ///< the head is the whole answer
  HttpResponse response;
};

Transport::Transport(const ClientOptions& options)
    : options_(options), url_(parse_server_url(options.url)), impl_(std::make_unique<Impl>()) {
  impl_->http = connect(url_, options_);
}

Transport::~Transport() = default;

Transport::Attempt Transport::attempt(const HttpRequest& request) {
  Attempt attempt;
  httplib::Request http;
  http.method = request.method;
  http.path = url_.path_prefix + request.path;
  for (const auto& [name, value] : request.headers) http.headers.emplace(name, value);
  http.headers.emplace("user-agent", options_.user_agent);
  if (!options_.token.empty()) http.headers.emplace("authorization", bearer(options_));
  http.body = request.body;
  http.response_handler = [&](const httplib::Response& response) {
    attempt.response.status = response.status;
    for (const auto& [name, value] : response.headers) {
      attempt.response.headers.emplace(lower_case(name), value);
    }
    // A 304 has no body, but the HTTP library would wait for the one its length may announce.
    attempt.no_body = response.status == 304 && attempt.response.header("content-length") != "0";
    return !attempt.no_body;
  };
  std::exception_ptr failure;  // not through the HTTP library, which is not made for it
  if (const auto& large = request.large_body) {
    http.content_length_ = large->length;
    http.content_provider_ = [&](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
      try {
        const std::string piece = large->read(offset, length);
        return !piece.empty() && sink.write(piece.data(), piece.size());
      } catch (...) {
        failure = std::current_exception();
        return false;
      }
    };
  }
  ++traffic_.requests;
  traffic_.sent_bytes += request.large_body ? request.large_body->length : request.body.size();
  http.content_receiver = [&](const char* data, std::size_t size, std::uint64_t, std::uint64_t) {
    traffic_.received_bytes += size;
    attempt.too_large = attempt.response.body.size() + size > request.max_answer_bytes;
    if (!attempt.too_large) attempt.response.body.append(data, size);
    return !attempt.too_large;
  };
  const httplib::Result result = impl_->http->send(http);
  if (failure) std::rethrow_exception(failure);
  attempt.error = attempt.no_body ? httplib::Error::Success : result.error();
  return attempt;
}

HttpResponse Transport::perform(const HttpRequest& request, bool accept_conflict) {
  RetrySchedule schedule(options_.retry);
  while (true) {
    Attempt tried = attempt(request);
    const std::string what = request.method + " " + to_string(url_) + request.path;
    if (tried.too_large) {
      throw Error(ErrorCode::kTooLarge, "the answer to " + what + " is longer than " +
                                            std::to_string(request.max_answer_bytes) + " bytes");
    }
    HttpResponse& response = tried.response;
    const bool answered = tried.error == httplib::Error::Success;
    if (answered && (response.status < 400 || (response.status == 409 && accept_conflict))) {
      if (response.header("content-encoding") == "zstd") {
        response.body = as_text(zstd_decompress(as_bytes(response.body), request.max_answer_bytes));
      }
      return std::move(response);
    }
    const bool again = answered ? refused_unprocessed(response.status) ||
                                      (gateway_failed(response.status) && request.idempotent)
                                : never_reached_the_server(tried.error) || request.idempotent;
    std::optional<std::chrono::milliseconds> delay;
    if (again) delay = schedule.next_delay(parse_retry_after(response.header("retry-after")));
    if (!delay && answered) {
      throw problem_to_error(response.status, response.header("content-type"), response.body, what);
    }
    if (!delay) throw connection_error(tried.error, request, url_);
    schedule.sleep(*delay);
  }
}

bool Transport::stream(const StreamRequest& request,
                       const std::function<bool(std::string_view)>& receive, std::stop_token stop) {
  const auto http = connect(url_, options_);
  if (request.max_silence.count() > 0) http->set_read_timeout(request.max_silence);
  const std::stop_callback on_stop(stop, [&] { http->stop(); });
  bool accepted = false;
  std::exception_ptr failure;  // not through the HTTP library, which is not made for it
  httplib::Headers headers = {{"user-agent", options_.user_agent}};
  if (!options_.token.empty()) headers.emplace("authorization", bearer(options_));
  for (const auto& [name, value] : request.headers) headers.emplace(name, value);
  ++traffic_.requests;
  const auto result = http->Get(
      url_.path_prefix + request.path, headers,
      [&](const httplib::Response& response) { return accepted = response.status == 200; },
      [&](const char* data, std::size_t size) {
        traffic_.received_bytes += size;
        try {
          return !stop.stop_requested() && receive({data, size});
        } catch (...) {
          failure = std::current_exception();
          return false;
        }
      });
  if (failure) std::rethrow_exception(failure);
  return accepted && (result || result.error() == httplib::Error::Canceled);
}

}  // namespace cellmap::client
