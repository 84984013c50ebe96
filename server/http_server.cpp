#include "server/http_server.hpp"

#include <httplib.h>
#include <sys/resource.h>

#include <algorithm>
#include <atomic>

#include "cellmap/core/error.hpp"
#include "server/api/failure.hpp"
#include "server/api/problem.hpp"
#include "server/api/standard_headers.hpp"
#include "server/api/text.hpp"
#include "server/http/client_address.hpp"
#include "server/http/send_answer.hpp"

// HTTP/1.1. What has no body (GET, HEAD) was read with its head, and is answered by `send_answer`;
// requests with bodies go through cpp-httplib, which reads them and writes their answers. What it
// would do by itself is kept from it: ranges are the API's, and bodies are sent through content
// providers, which it does not compress.

namespace cellmap::server {
namespace {

constexpr std::size_t kPieceBytes = 256u << 10;  // of a file that is sent

/// A connection as httplib sees it. Remembers what the answer's head said.
class HttplibStream : public httplib::Stream {
 public:
  explicit HttplibStream(Connection& connection) : connection_(connection) {}

  void begin_body() { in_head_ = false; }
  std::size_t body_read() const { return body_read_; }
  /// True where the answer announced the end of the connection.
  bool says_close() const { return says_close_; }

  bool is_readable() const override { return true; }
  /// So that a stream to nobody ends.
  bool is_writable() const override { return !connection_.is_closed_by_peer(); }

  ssize_t read(char* data, size_t size) override {
    const std::size_t count = connection_.read(data, size);
    if (!in_head_) body_read_ += count;
    return count > 0 ? static_cast<ssize_t>(count) : -1;
  }

  ssize_t write(const char* data, size_t size) override {
    note_head({data, size});
    return connection_.write({data, size}) ? static_cast<ssize_t>(size) : -1;
  }

  void get_remote_ip_and_port(std::string& ip, int& port) const override {
    ip = connection_.address();
    port = 0;
  }
  void get_local_ip_and_port(std::string& ip, int& port) const override {
    ip.clear();
    port = 0;
  }
  socket_t socket() const override { return connection_.socket(); }

 private:
  /// httplib writes the head of an answer at once. 100 Continue is no answer.
  void note_head(std::string_view text) {
    if (answered_ || !text.starts_with("HTTP/1.1 ") || text.starts_with("HTTP/1.1 100")) return;
    answered_ = true;
    const auto head = text.substr(0, text.find("\r\n\r\n") + 2);
    says_close_ = head.find("\r\nConnection: close\r\n") != std::string_view::npos;
    // A body in chunks comes as its source makes it.
    if (head.find("\r\nTransfer-Encoding: chunked\r\n") != std::string_view::npos) {
      connection_.send_at_once();
    }
  }

  Connection& connection_;
  bool in_head_ = true, answered_ = false, says_close_ = false;
  std::size_t body_read_ = 0;
};

/// As many as the machine lets this process have, and some for files.
void allow_descriptors(std::size_t connections) {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, connections + 1024);
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

}  // namespace

struct HttpServer::Impl : httplib::Server {
  Impl(Api& api_in, std::shared_ptr<spdlog::logger> log_in) : api(api_in), log(std::move(log_in)) {
    svr_sock_ = 0;  // httplib ends every body where it has no socket of its own
    // Only what the Keep-Alive field says: the front keeps connections.
    set_keep_alive_max_count(1'000'000);
    set_handlers();
  }

  void set_handlers() {
    // What httplib refuses by itself (a malformed head, an unknown method) gets a problem document.
    set_error_handler(
        HandlerWithResponse([this](const httplib::Request& request, httplib::Response& response) {
          if (response.content_provider_ || response.content_length_ > 0) {
            return HandlerResponse::Unhandled;
          }
          const int status = response.status;
          auto refused = status == 405 || status == 404
                             ? problem(ErrorCode::kNotFound, "There is no such resource or method.")
                             : problem_with_status(status, ErrorCode::kInvalidArgument,
                                                   "The request cannot be read.");
          answer(request, response, std::move(refused), false);
          return HandlerResponse::Handled;
        }));
    set_exception_handler([this](const httplib::Request& request, httplib::Response& response,
                                 const std::exception_ptr& failure) {
      // What a handler throws, the API answers; so it was the reading of a body.
      const std::string id = next_id();
      log_failure(id, failure);
      Response failed = problem_of(failure, id);
      failed.headers.set("X-Request-Id", id);
      answer(request, response, std::move(failed), false);
    });
    const auto bare = [this](const httplib::Request& request, httplib::Response& response) {
      answer(request, response, api.handle(read_head(request)), true);
    };
    const auto with_body = [this](const httplib::Request& request, httplib::Response& response,
                                  const httplib::ContentReader& reader) {
      read_and_handle(request, response, reader);
    };
    // Before httplib's routes, whose patterns cost more than most answers.
    set_pre_routing_handler([bare](const httplib::Request& request, httplib::Response& response) {
      const bool is_bare =
          request.method == "GET" || request.method == "HEAD" || request.method == "OPTIONS";
      if (is_bare) bare(request, response);
      return is_bare ? HandlerResponse::Handled : HandlerResponse::Unhandled;
    });
    Post(".*", with_body);
    Put(".*", with_body);
    Patch(".*", with_body);
    Delete(".*", with_body);
  }

  void log_failure(const std::string& id, const std::exception_ptr& failure) {
    try {
      std::rethrow_exception(failure);
    } catch (const std::exception& error) {
      log->error("[{}] the body: {}", id, error.what());
    }
  }

  server::Request read_head(const httplib::Request& request) {
    server::Request own;
    own.method = request.method;
    own.target = request.target;
    for (const auto& [name, value] : request.headers) own.headers.add(name, value);
    identify(own, request.remote_addr);
    return own;
  }

  void identify(server::Request& request, const std::string& peer) {
    request.address = client_address(peer, request.headers.get("X-Forwarded-For"), trusted_proxies);
    auto given = given_request_id(request.headers);
    request.id = given ? *std::move(given) : next_id();
  }

  std::string next_id() { return instance + "-" + std::to_string(++request_count); }

  void read_and_handle(const httplib::Request& request, httplib::Response& response,
                       const httplib::ContentReader& reader) {
    // Without either field there is no body; httplib would wait for the connection to close.
    const bool has_body =
        request.has_header("Transfer-Encoding") ||
        parse_unsigned(request.get_header_value("Content-Length")).value_or(0) > 0;
    // Who may not send it has none of it read.
    server::Request own = read_head(request);
    if (auto refusal = api.refuse(own)) {
      return answer(request, response, *std::move(refusal), !has_body);
    }
    own.file = api.file_for_body(request.method, request.target);
    if (has_body) {
      const std::size_t limit = api.max_body(request.method, request.target);
      bool too_large =
          parse_unsigned(request.get_header_value("Content-Length")).value_or(0) > limit;
      std::size_t length = 0;
      const bool complete = !too_large && reader([&](const char* data, std::size_t size) {
        too_large = size > limit - length;
        if (too_large) return false;
        own.file ? own.file->write(length, as_bytes({data, size}))
                 : void(own.body.append(data, size));
        length += size;
        return true;
      });
      if (too_large && limit > 0) {
        return answer(request, response,
                      problem(ErrorCode::kTooLarge, "The body may have at most " +
                                                        std::to_string(limit) + " bytes here."),
                      false);
      }
      if (!complete && limit > 0) {
        return answer(request, response,
                      problem(ErrorCode::kInvalidArgument, "The body ended early or is malformed."),
                      false);
      }
      if (!complete) return answer(request, response, api.handle(own), false);
    }
    answer(request, response, api.handle(own), true);
  }

  /// Hands a response to httplib. `keep`: the connection can take another request.
  void answer(const httplib::Request& request, httplib::Response& out, Response&& response,
              bool keep) {
    out.status = response.status;
    if (!response.headers.get("X-Request-Id")) {
      api.complete(response, request.target, read_head(request).id);
    }
    std::string type = "application/octet-stream";
    for (const auto& [name, value] : response.headers.fields()) {
      if (equal_no_case(name, "Content-Type")) {
        type = value;
      } else {
        out.headers.emplace(name, value);
      }
    }
    if (!keep) out.headers.emplace("Connection", "close");
    if (auto* stream = std::get_if<BodyStream>(&response.body)) {
      out.set_chunked_content_provider(
          type, [this, next = std::move(*stream)](std::size_t, httplib::DataSink& sink) {
            std::string chunk;
            const bool more = next(chunk) && !front->is_stopping();
            if (!chunk.empty()) sink.write(chunk.data(), chunk.size());
            if (!more) sink.done();
            return true;
          });
      return;
    }
    if (const auto* part = std::get_if<FileBody>(&response.body); part && part->length > 0) {
      out.set_content_provider(
          part->length, type,
          [part = *part](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
            const Bytes piece =
                part.file->read(part.offset + offset, std::min(length, kPieceBytes));
            return !piece.empty() &&
                   sink.write(reinterpret_cast<const char*>(piece.data()), piece.size());
          });
      return;
    }
    const auto held = std::make_shared<Response>(std::move(response));
    const auto body = body_view(*held);
    if (body.empty()) {
      const bool can_have_body = held->status != 204 && held->status != 304;
      if (can_have_body && !request.method.empty()) out.set_header("Content-Type", type);
      return;
    }
    out.set_content_provider(
        body.size(), type,
        [held, body](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
          sink.write(body.data() + offset, length);
          return true;
        });
  }

  bool serve(Connection& connection, const RequestHead& head) {
    const bool is_bare = (head.method == "GET" || head.method == "HEAD") && !head.has_body();
    return is_bare ? serve_bare(connection, head) : serve_with_body(connection, head);
  }

  /// What is asked for most is read already, and answered in one call.
  bool serve_bare(Connection& connection, const RequestHead& head) {
    server::Request request;
    request.method = head.method;
    request.target = head.target;
    for (const auto& [name, value] : head.fields) request.headers.add(name, value);
    identify(request, connection.address());
    const AnswerForm form{request.method == "HEAD", head.is_http_1_0, head.keep};
    connection.skip(head.size);
    return send_answer(connection, api.handle(request), form, files);
  }

  bool serve_with_body(Connection& connection, const RequestHead& head) {
    // Copied: the head's bytes are read over.
    const std::uint64_t declared = head.content_length;
    const bool chunked = head.chunked;
    const bool reads_body = head.method != "GET" && head.method != "HEAD";
    HttplibStream stream(connection);
    bool close = false;
    const bool served = process_request(stream, false, close, [&](httplib::Request& request) {
      request.ranges.clear();  // the API's business
      stream.begin_body();
    });
    // What nobody read of a body must not be taken for the next request.
    const bool unread =
        stream.body_read() < declared || (chunked && (!reads_body || stream.says_close()));
    return served && !close && !unread && !stream.says_close();
  }

  Api& api;
  std::shared_ptr<spdlog::logger> log;
  BodyFiles files;
  std::string instance = std::to_string(Clock::now().time_since_epoch().count() % 1'000'000'007);
  std::atomic<std::uint64_t> request_count = 0;
  std::vector<std::string> urls;
  int port = 0;
  std::vector<std::string> trusted_proxies;
  std::unique_ptr<Front> front;
};

HttpServer::HttpServer(Api& api, std::shared_ptr<spdlog::logger> log, HttpServerOptions options)
    : impl_(std::make_unique<Impl>(api, std::move(log))) {
  allow_descriptors(options.front.max_connections);
  impl_->trusted_proxies = std::move(options.trusted_proxies);
  std::vector<Listener> listeners;
  for (const std::string& address : options.listen) listeners.emplace_back(address);
  if (listeners.empty()) {
    throw Error(ErrorCode::kInvalidArgument, "Expected at least one address to listen on.");
  }
  for (const Listener& listener : listeners) impl_->urls.push_back(listener.url());
  impl_->port = listeners.front().port();
  impl_->front = std::make_unique<Front>(
      std::move(listeners), std::move(options.front),
      FrontHandlers{
          [this](const RequestHead& head) { return impl_->api.may_wait(head.method, head.target); },
          [this](Connection& connection, const RequestHead& head) {
            return impl_->serve(connection, head);
          },
          [this](const std::exception& error) {
            impl_->log->error("a connection failed: {}", error.what());
          },
          [this](Response& response) { impl_->api.complete(response, "", impl_->next_id()); }});
}

HttpServer::~HttpServer() = default;

int HttpServer::port() const { return impl_->port; }

const std::vector<std::string>& HttpServer::urls() const { return impl_->urls; }

void HttpServer::run() { impl_->front->run(); }

void HttpServer::stop() { impl_->front->stop(); }

}  // namespace cellmap::server
