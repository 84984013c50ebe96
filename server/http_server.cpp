#include "server/http_server.hpp"

#include <httplib.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <list>
#include <mutex>
#include <thread>

#include "cellmap/core/error.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"

// What is wrong with the stock server, and what is done about it (measured; Debian's cpp-httplib
// 0.11.4):
// - it keeps a thread a connection, a pool of few, for 5 s idle: here threads grow with the
// connections to a
//   limit, and idle ones end sooner when threads get scarce;
// - it bounds neither heads nor bodies: the Connection below counts what is read and when;
// - a body that no handler read would be executed as the next request: such a connection is closed;
// - it answers ranges and compresses by itself: ranges are the API's, and bodies are sent through
// content
//   providers, which it leaves alone;
// - its listen backlog is 5: the socket listens again.

namespace cellmap::server {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kPieceBytes = 256u << 10;  // of a file that is sent

/// Waits for a socket to be ready; false when time is up or `stop` is set.
bool wait_for(socket_t socket, short events, Clock::time_point deadline,
              const std::atomic<bool>& stop) {
  constexpr std::chrono::milliseconds kTick(100);  // how soon a stop is noticed
  for (;;) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now());
    if (left.count() <= 0) return false;
    pollfd entry{socket, events, 0};
    const int ready = ::poll(&entry, 1, static_cast<int>(std::min(left, kTick).count()) + 1);
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
    if (stop) return false;
  }
}

/// A connection as httplib sees it: a stream with a budget and a deadline for each head and body.
class Connection : public httplib::Stream {
 public:
  Connection(socket_t socket, const HttpServerOptions& options, const std::atomic<bool>& stop)
      : socket_(socket), options_(options), stop_(stop) {}

  /// Waits for the first byte of the next request.
  bool wait_for_request(std::chrono::milliseconds timeout) {
    return begin_ < end_ || wait_for(socket_, POLLIN, Clock::now() + timeout, stop_);
  }

  void begin_head() {
    budget_ = options_.max_head_bytes;
    deadline_ = Clock::now() + options_.head_timeout;
    in_head_ = true;
    over_budget_ = false;
    body_read_ = 0;
    answered_ = says_close_ = false;
  }

  /// `is_large`: it may take long, but not without progress.
  void begin_body(bool is_large) {
    budget_ = SIZE_MAX;  // the handler counts
    deadline_ = Clock::now() + options_.body_timeout;
    large_body_ends_ = is_large ? Clock::now() + options_.large_body_timeout : deadline_;
    in_head_ = false;
  }

  bool is_head_too_large() const { return over_budget_; }
  bool is_answered() const { return answered_; }
  /// True where the answer announced the end of the connection.
  bool says_close() const { return says_close_; }
  std::size_t body_read() const { return body_read_; }

  /// Lets the peer read the answer before the connection is reset for what it still sends.
  void drain() {
    ::shutdown(socket_, SHUT_WR);
    const auto deadline = Clock::now() + std::chrono::seconds(1);
    std::array<char, 16384> waste;
    while (wait_for(socket_, POLLIN, deadline, stop_)) {
      if (::recv(socket_, waste.data(), waste.size(), 0) <= 0) return;
    }
  }

  bool is_readable() const override { return true; }

  /// Also false where the peer has closed, so that a stream to nobody ends.
  bool is_writable() const override {
    char byte;
    return ::recv(socket_, &byte, 1, MSG_PEEK | MSG_DONTWAIT) != 0;
  }

  ssize_t read(char* data, size_t size) override {
    size = std::min(size, budget_);
    if (size == 0) {
      over_budget_ = true;
      return -1;
    }
    if (begin_ == end_ && !fill()) return -1;
    size = std::min(size, end_ - begin_);
    std::copy_n(buffer_.data() + begin_, size, data);
    begin_ += size;
    budget_ -= size;
    if (!in_head_) body_read_ += size;
    return static_cast<ssize_t>(size);
  }

  ssize_t write(const char* data, size_t size) override {
    if (over_budget_) return -1;  // the front answers that itself
    note_head(data, size);
    return send_all(data, size) ? static_cast<ssize_t>(size) : -1;
  }

  bool send_all(const char* data, size_t size) {
    while (size > 0) {
      const ssize_t sent = ::send(socket_, data, size, MSG_NOSIGNAL | MSG_DONTWAIT);
      if (sent > 0) {
        data += sent;
        size -= static_cast<size_t>(sent);
      } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
        const auto deadline = Clock::now() + options_.write_timeout;
        if (!wait_for(socket_, POLLOUT, deadline, never_)) return false;
      } else if (errno != EINTR) {
        return false;
      }
    }
    return true;
  }

  void get_remote_ip_and_port(std::string& ip, int& port) const override {
    ip.clear();
    port = 0;
  }
  void get_local_ip_and_port(std::string& ip, int& port) const override {
    get_remote_ip_and_port(ip, port);
  }
  socket_t socket() const override { return socket_; }

 private:
  bool fill() {
    if (!in_head_ && large_body_ends_ > deadline_) {
      deadline_ = std::min(Clock::now() + options_.body_timeout, large_body_ends_);
    }
    if (!wait_for(socket_, POLLIN, deadline_, stop_)) return false;
    const ssize_t received = ::recv(socket_, buffer_.data(), buffer_.size(), 0);
    if (received <= 0) return false;
    begin_ = 0;
    end_ = static_cast<size_t>(received);
    return true;
  }

  /// httplib writes the head of an answer at once. 100 Continue is no answer.
  void note_head(const char* data, size_t size) {
    const std::string_view text(data, size);
    if (answered_ || !text.starts_with("HTTP/1.1 ") || text.starts_with("HTTP/1.1 100")) return;
    answered_ = true;
    const auto head = text.substr(0, text.find("\r\n\r\n") + 2);
    says_close_ = head.find("\r\nConnection: close\r\n") != std::string_view::npos;
  }

  socket_t socket_;
  const HttpServerOptions& options_;
  const std::atomic<bool>& stop_;
  const std::atomic<bool> never_ = false;
  std::array<char, 16384> buffer_;
  std::size_t begin_ = 0, end_ = 0;
  std::size_t budget_ = 0;
  Clock::time_point deadline_, large_body_ends_;
  bool in_head_ = true;
  bool over_budget_ = false;
  std::size_t body_read_ = 0;
  bool answered_ = false, says_close_ = false;
};

/// Threads that grow with the connections up to a limit; further connections wait for one.
class ConnectionThreads : public httplib::TaskQueue {
 public:
  explicit ConnectionThreads(std::size_t max_threads) : max_threads_(max_threads) {}

  void enqueue(std::function<void()> serve) override {
    const std::lock_guard lock(mutex_);
    waiting_.push_back(std::move(serve));
    if (idle_ < waiting_.size() && threads_.size() < max_threads_) {
      threads_.emplace_back([this] { work(); });
    }
    ready_.notify_one();
  }

  void shutdown() override {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
      ready_.notify_all();
    }
    for (auto& thread : threads_) thread.join();
  }

 private:
  void work() {
    for (;;) {
      std::function<void()> serve;
      {
        std::unique_lock lock(mutex_);
        ++idle_;
        ready_.wait(lock, [&] { return ending_ || !waiting_.empty(); });
        --idle_;
        if (waiting_.empty()) return;
        serve = std::move(waiting_.front());
        waiting_.pop_front();
      }
      serve();
    }
  }

  std::size_t max_threads_;
  std::mutex mutex_;
  std::condition_variable ready_;
  std::deque<std::function<void()>> waiting_;
  std::list<std::thread> threads_;
  std::size_t idle_ = 0;
  bool ending_ = false;
};

std::string head_of(const Response& response, std::size_t length) {
  std::string head = "HTTP/1.1 " + std::to_string(response.status) + " Refused\r\n";
  for (const auto& [name, value] : response.headers.fields()) head += name + ": " + value + "\r\n";
  return head + "Content-Length: " + std::to_string(length) + "\r\nConnection: close\r\n\r\n";
}

/// Why a request is refused from its head alone; nullopt: it is not.
std::optional<Response> refuse_head(const httplib::Request& request, std::size_t max_fields) {
  const auto bad = [](const std::string& detail) {
    return problem(ErrorCode::kInvalidArgument, detail);
  };
  if (request.headers.size() > max_fields) {
    return problem_with_status(
        431, ErrorCode::kTooLarge,
        "A request may have " + std::to_string(max_fields) + " header fields.");
  }
  for (const auto& [name, value] : request.headers) {
    // httplib decodes percent-escapes here, so that a line feed can hide in a value.
    const bool control = std::ranges::any_of(
        value, [](unsigned char c) { return (c < 0x20 && c != '\t') || c == 0x7f; });
    if (control) return bad("A header field holds a control character.");
  }
  const auto lengths = request.headers.count("Content-Length");
  const bool chunked = request.has_header("Transfer-Encoding");
  if (lengths > 1 || (lengths == 1 && chunked)) {
    return bad("The length of the body is given twice.");
  }
  if (chunked && !equal_no_case(request.get_header_value("Transfer-Encoding"), "chunked")) {
    return problem(ErrorCode::kUnsupported, "Only the transfer coding 'chunked' is read.");
  }
  if (lengths == 1 && !parse_unsigned(request.get_header_value("Content-Length"))) {
    return bad("Content-Length is not a number.");
  }
  const auto coding = request.get_header_value("Content-Encoding");
  if (!coding.empty() && !equal_no_case(coding, "identity") && !equal_no_case(coding, "zstd")) {
    return problem(
        ErrorCode::kUnsupported,
        "Bodies are read with Content-Encoding zstd or none, not " + in_quotes(coding) + ".");
  }
  if (request.is_multipart_form_data()) {
    return problem(ErrorCode::kUnsupported, "Forms are not read.");
  }
  return std::nullopt;
}

}  // namespace

struct HttpServer::Impl : httplib::Server {
  Impl(Api& api_in, std::shared_ptr<spdlog::logger> log_in, HttpServerOptions options_in)
      : api(api_in), log(std::move(log_in)), options(std::move(options_in)) {
    new_task_queue = [this] { return new ConnectionThreads(options.max_connections); };
    set_tcp_nodelay(true);
    // Only what the Keep-Alive field says: the loop below keeps connections.
    set_keep_alive_timeout(
        std::chrono::duration_cast<std::chrono::seconds>(options.idle_timeout).count());
    set_keep_alive_max_count(1'000'000);
    set_handlers();
  }

  void set_handlers() {
    set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
      if (auto refused = refuse_head(request, options.max_header_fields)) {
        answer(request, response, *std::move(refused), false);
        return HandlerResponse::Handled;
      }
      return HandlerResponse::Unhandled;
    });
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
                                 const std::exception_ptr&) {
      answer(request, response, problem(ErrorCode::kInternal, "The server failed."), false);
    });
    const auto bare = [this](const httplib::Request& request, httplib::Response& response) {
      answer(request, response, handle(request, {}, nullptr), true);
    };
    const auto with_body = [this](const httplib::Request& request, httplib::Response& response,
                                  const httplib::ContentReader& reader) {
      read_and_handle(request, response, reader);
    };
    Get(".*", bare);
    Options(".*", bare);
    Post(".*", with_body);
    Put(".*", with_body);
    Patch(".*", with_body);
    Delete(".*", with_body);
  }

  Response handle(const httplib::Request& request, std::string body,
                  std::shared_ptr<ByteFile> file) {
    server::Request own;
    own.method = request.method;
    own.target = request.target;
    for (const auto& [name, value] : request.headers) own.headers.add(name, value);
    own.body = std::move(body);
    own.file = std::move(file);
    own.id = next_id();
    return api.handle(own);
  }

  std::string next_id() { return instance + "-" + std::to_string(++request_count); }

  void read_and_handle(const httplib::Request& request, httplib::Response& response,
                       const httplib::ContentReader& reader) {
    // Without either field there is no body; httplib would wait for the connection to close.
    const bool has_body =
        request.has_header("Transfer-Encoding") ||
        parse_unsigned(request.get_header_value("Content-Length")).value_or(0) > 0;
    std::string body;
    std::shared_ptr<ByteFile> file = api.file_for_body(request.method, request.target);
    if (has_body) {
      const std::size_t limit = api.max_body(request.method, request.target);
      bool too_large =
          parse_unsigned(request.get_header_value("Content-Length")).value_or(0) > limit;
      std::size_t length = 0;
      const bool complete = !too_large && reader([&](const char* data, std::size_t size) {
        too_large = size > limit - length;
        if (too_large) return false;
        file ? file->write(length, as_bytes({data, size})) : void(body.append(data, size));
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
      if (!complete) return answer(request, response, handle(request, {}, nullptr), false);
    }
    answer(request, response, handle(request, std::move(body), std::move(file)), true);
  }

  /// Hands a response to httplib. `keep`: the connection can take another request.
  void answer(const httplib::Request& request, httplib::Response& out, Response&& response,
              bool keep) {
    out.status = response.status;
    set_instance(response, std::string_view(request.target).substr(0, request.target.find('?')));
    if (!response.headers.get("X-Request-Id")) response.headers.set("X-Request-Id", next_id());
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
            const bool more = next(chunk) && !stopping;
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

  bool process_and_close_socket(socket_t socket) override {
    ++connections;
    try {
      serve(socket);
    } catch (const std::exception& error) {
      log->error("a connection failed: {}", error.what());
    }
    ::shutdown(socket, SHUT_RDWR);
    ::close(socket);
    --connections;
    return true;
  }

  std::chrono::milliseconds idle_timeout() const {
    const bool busy = connections > options.max_connections / 2;
    return busy ? options.busy_idle_timeout : options.idle_timeout;
  }

  /// Idle in short steps, because how long a client may idle depends on how many there are.
  bool wait_for_request(Connection& connection) const {
    const auto start = Clock::now();
    while (!stopping && Clock::now() - start < idle_timeout()) {
      if (connection.wait_for_request(std::chrono::milliseconds(200))) return true;
    }
    return false;
  }

  void serve(socket_t socket) {
    Connection connection(socket, options, stopping);
    while (wait_for_request(connection)) {
      if (!serve_one(connection)) return;
    }
  }

  /// Answers one request; false where the connection has to be closed.
  bool serve_one(Connection& connection) {
    std::size_t declared = 0;
    bool head_read = false, chunked = false, reads_body = false;
    connection.begin_head();
    bool close = false;
    const bool served = process_request(connection, false, close, [&](httplib::Request& request) {
      head_read = true;
      request.ranges.clear();  // the API's business
      declared = parse_unsigned(request.get_header_value("Content-Length")).value_or(0);
      chunked = request.has_header("Transfer-Encoding");
      reads_body = request.method != "GET" && request.method != "HEAD";
      connection.begin_body(api.takes_large_body(request.method, request.target));
    });
    if (connection.is_head_too_large()) {
      auto refused = problem_with_status(431, ErrorCode::kTooLarge, "The head is too large.");
      const auto body = body_view(refused);
      const std::string text = head_of(refused, body.size()) + std::string(body);
      connection.send_all(text.data(), text.size());
      connection.drain();
      return false;
    }
    const bool unread = connection.body_read() < declared || (chunked && !reads_body) ||
                        (chunked && connection.says_close());
    if (unread && connection.is_answered()) connection.drain();
    return served && head_read && !close && !unread && !connection.says_close() && !stopping;
  }

  Api& api;
  std::shared_ptr<spdlog::logger> log;
  HttpServerOptions options;
  std::string instance = std::to_string(Clock::now().time_since_epoch().count() % 1'000'000'007);
  std::atomic<std::uint64_t> request_count = 0;
  std::atomic<std::size_t> connections = 0;
  std::atomic<bool> stopping = false;
  int bound_port = -1;

  void listen_with_long_queue() { ::listen(svr_sock_, SOMAXCONN); }
};

HttpServer::HttpServer(Api& api, std::shared_ptr<spdlog::logger> log, HttpServerOptions options)
    : impl_(std::make_unique<Impl>(api, std::move(log), std::move(options))) {
  const auto& host = impl_->options.host;
  const int port = impl_->options.port;
  if (port == 0) {
    impl_->bound_port = impl_->bind_to_any_port(host);
  } else if (impl_->bind_to_port(host, port)) {
    impl_->bound_port = port;
  }
  if (impl_->bound_port <= 0) {
    throw Error(ErrorCode::kIo, "Cannot listen on " + host + ":" + std::to_string(port) +
                                    "; is the address this machine's and free?");
  }
  impl_->listen_with_long_queue();
}

HttpServer::~HttpServer() = default;

int HttpServer::port() const { return impl_->bound_port; }

void HttpServer::run() { impl_->listen_after_bind(); }

void HttpServer::stop() {
  impl_->stopping = true;
  impl_->httplib::Server::stop();
}

}  // namespace cellmap::server
