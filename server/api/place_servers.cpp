#include "server/api/place_servers.hpp"

#include <httplib.h>

#include <algorithm>
#include <array>
#include <future>
#include <utility>

#include "cellmap/core/error.hpp"
#include "server/api/message.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

using Clock = std::chrono::steady_clock;

/// It is well, but busy, or does not know the caller: that says nothing of the next question.
bool is_about_the_caller(int status) {
  constexpr std::array kStatuses{401, 403, 429, 503};
  return std::ranges::find(kStatuses, status) != kStatuses.end();
}

httplib::Headers headers_of(const OnBehalfOf& caller) {
  httplib::Headers headers{{"Accept", kPlaceAnswerType}, {"X-Request-Id", caller.request_id}};
  if (caller.authorization) headers.emplace("Authorization", *caller.authorization);
  // Of an IPv6 address the network is known alone, as NETWORK/64.
  const auto address = caller.address.substr(0, caller.address.find('/'));
  if (!address.empty()) headers.emplace("X-Forwarded-For", address);
  return headers;
}

std::unique_ptr<httplib::Client> connected_to(const std::string& url, Clock::time_point deadline) {
  auto http = std::make_unique<httplib::Client>(url);
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
  const auto patience = std::max(left, std::chrono::milliseconds(1));
  http->set_connection_timeout(patience);
  http->set_read_timeout(patience);
  http->set_write_timeout(patience);
  http->set_tcp_nodelay(true);
  return http;
}

}  // namespace

struct PlaceServer::Reply {
  int status = 0;    ///< 0: none came in time
  std::string body;  ///< or why
};

PlaceServer::PlaceServer(std::string url, const PlaceServersOptions& options, Metrics& metrics,
                         std::shared_ptr<spdlog::logger> log)
    : url_(std::move(url)), pause_(options.pause), metrics_(metrics), log_(std::move(log)) {}

bool PlaceServer::is_left_alone() const {
  return Clock::now().time_since_epoch().count() < alone_until_;
}

/// A thread of its own waits for the answer, so that bytes that trickle in do not hold it up: at
/// the deadline the connection is cut.
PlaceServer::Reply PlaceServer::post(const std::string& path, const Bytes& body,
                                     const OnBehalfOf& caller, Deadline deadline) const {
  Reply reply;
  const auto http = connected_to(url_, deadline);
  httplib::Request request;
  request.method = "POST";
  request.path = path;
  request.headers = headers_of(caller);
  request.headers.emplace("Content-Type", kPlaceQueryType);
  request.body.assign(reinterpret_cast<const char*>(body.data()), body.size());
  request.response_handler = [&](const httplib::Response& response) {
    reply.status = response.status;
    return true;
  };
  request.content_receiver = [&](const char* data, std::size_t size, std::uint64_t, std::uint64_t) {
    reply.body.append(data, size);
    return reply.body.size() <= kMaxPlaceAnswerBytes;
  };
  auto result = std::async(std::launch::async, [&] { return http->send(request); });
  if (result.wait_until(deadline) == std::future_status::timeout) http->stop();
  if (const auto sent = result.get(); !sent) {
    reply = {0, Clock::now() >= deadline ? "no answer in time" : httplib::to_string(sent.error())};
  }
  return reply;
}

std::optional<PlaceAnswer> PlaceServer::ask(const std::string& map, const PlaceQuery& query,
                                            const OnBehalfOf& caller, Deadline deadline) {
  try {
    const Bytes body = encode_place_query(query);
    const Reply reply = post("/v1/maps/" + map + "/places:search", body, caller, deadline);
    if (reply.status == 200) {
      auto answer = decode_place_answer(as_bytes(reply.body), query.terms, query.regions.size());
      metrics_.place_server_asked(url_, "answered");
      return answer;
    }
    failed(
        reply.status == 0 ? reply.body : std::to_string(reply.status) + " " + in_quotes(reply.body),
        !is_about_the_caller(reply.status));
  } catch (const Error& error) {
    failed(error.what());
  }
  return std::nullopt;
}

void PlaceServer::failed(const std::string& why, bool leave_alone) {
  metrics_.place_server_asked(url_, "failed");
  if (leave_alone) alone_until_ = (Clock::now() + pause_).time_since_epoch().count();
  if (says_why_()) {
    log_->warn("searches the regions of {} itself, which does not: {}", url_, why);
  }
}

PlaceServers::PlaceServers(PlaceServersOptions options, Metrics& metrics,
                           const std::shared_ptr<spdlog::logger>& log)
    : options_(std::move(options)) {
  for (const std::string& url : options_.servers) {
    servers_.push_back(std::make_unique<PlaceServer>(url, options_, metrics, log));
  }
  const auto own = std::ranges::find(options_.servers, options_.self);
  if (!servers_.empty() && own == options_.servers.end()) {
    throw Error(ErrorCode::kInvalidArgument, "This server is none of the place servers.");
  }
  self_ = static_cast<std::size_t>(own - options_.servers.begin());
}

}  // namespace cellmap::server
