#include "cellmap/store/object_store.hpp"

#include <curl/curl.h>

#include <algorithm>
#include <charconv>
#include <mutex>
#include <string_view>
#include <utility>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/store/database_outage.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kMostPut = std::size_t{1} << 30;
constexpr std::size_t kMostListed = 16u << 20, kMostOfAnError = 16u << 10;

using Easy = std::unique_ptr<CURL, void (*)(CURL*)>;
using Headers = std::unique_ptr<curl_slist, void (*)(curl_slist*)>;

/// What stands between two tags, from a position on, which moves behind them; nullopt: nothing
/// more.
std::optional<std::string> next_of(std::string_view text, std::string_view tag, std::size_t& from) {
  const std::string open = "<" + std::string(tag) + ">", close = "</" + std::string(tag) + ">";
  const auto begin = text.find(open, from);
  if (begin == text.npos) return std::nullopt;
  const auto end = text.find(close, begin);
  if (end == text.npos) return std::nullopt;
  from = end + close.size();
  return std::string(text.substr(begin + open.size(), end - begin - open.size()));
}

std::string first_of(std::string_view text, std::string_view tag) {
  std::size_t from = 0;
  return next_of(text, tag, from).value_or("");
}

struct Answer {
  long status = 0;
  Bytes body;
  std::size_t most = 0;  ///< of the body
  bool is_too_long = false;

  std::string_view text() const {
    return {reinterpret_cast<const char*>(body.data()), body.size()};
  }
};

std::size_t take(char* data, std::size_t, std::size_t count, void* to) {
  Answer& answer = *static_cast<Answer*>(to);
  if (count > answer.most - answer.body.size()) {
    answer.is_too_long = true;
    return 0;  // ends the request
  }
  const auto* const bytes = reinterpret_cast<const std::byte*>(data);
  answer.body.insert(answer.body.end(), bytes, bytes + count);
  return count;
}

class S3Store final : public ObjectStore {
 public:
  explicit S3Store(const ObjectStoreOptions& options)
      : options_(options), prefix_(options.prefix()) {
    base_ = options.endpoint.empty() ? "https://s3." + options.region + ".amazonaws.com"
                                     : options.endpoint;
    while (base_.ends_with('/')) base_.pop_back();
    base_ += "/" + options.bucket();
  }

  void put(const std::string& name, std::span<const std::byte> bytes) override {
    if (bytes.size() > kMostPut) throw Error(ErrorCode::kTooLarge, "an object is at most 1 GiB");
    const Answer answer = request("PUT", url(name), bytes, kMostOfAnError);
    if (answer.status != 200) refuse(answer);
  }

  std::optional<Bytes> get(const std::string& name, std::size_t most) override {
    Answer answer = request("GET", url(name), {}, std::max(most, kMostOfAnError));
    if (answer.status == 404 && first_of(answer.text(), "Code") != "NoSuchBucket") {
      return std::nullopt;
    }
    if (answer.status != 200) refuse(answer);
    if (answer.body.size() > most) throw too_long();
    return std::move(answer.body);
  }

  void remove(const std::string& name) override {
    const Answer answer = request("DELETE", url(name), {}, kMostOfAnError);
    const bool is_absent =
        answer.status == 404 && first_of(answer.text(), "Code") != "NoSuchBucket";
    if (answer.status != 204 && answer.status != 200 && !is_absent) refuse(answer);
  }

  void list(const std::function<void(const StoredObject&)>& each) override {
    std::string after;
    do {
      // Sorted and escaped, as the signature wants the question.
      const std::string question =
          (after.empty() ? "" : "continuation-token=" + escaped(after) + "&") +
          "list-type=2&prefix=" + escaped(prefix_);
      const Answer answer = request("GET", base_ + "?" + question, {}, kMostListed);
      if (answer.status != 200) refuse(answer);
      std::size_t from = 0;
      while (const auto entry = next_of(answer.text(), "Contents", from)) each(object_of(*entry));
      after = first_of(answer.text(), "NextContinuationToken");
      if (first_of(answer.text(), "IsTruncated") == "true" && after.empty()) refuse(answer);
    } while (!after.empty());
  }

 private:
  std::string url(const std::string& name) const {
    if (!is_object_name(name)) {
      throw Error(ErrorCode::kInvalidArgument, "an object's name has other characters");
    }
    return base_ + "/" + prefix_ + name;
  }

  static std::string escaped(const std::string& text) {
    const std::unique_ptr<char, void (*)(void*)> copy(
        curl_easy_escape(nullptr, text.data(), static_cast<int>(text.size())), curl_free);
    return copy ? copy.get() : "";
  }

  StoredObject object_of(std::string_view entry) const {
    StoredObject object{first_of(entry, "Key"), 0};
    const std::string size = first_of(entry, "Size");
    const auto read = std::from_chars(size.data(), size.data() + size.size(), object.bytes);
    if (read.ec != std::errc() || !object.name.starts_with(prefix_)) {
      throw Error(ErrorCode::kInternal, "store: the object store's listing is not understood");
    }
    object.name.erase(0, prefix_.size());
    return object;
  }

  /// A handle keeps its connection, so it is used again.
  Easy take_handle() {
    const std::lock_guard lock(mutex_);
    if (free_.empty()) return {curl_easy_init(), curl_easy_cleanup};
    Easy handle = std::move(free_.back());
    free_.pop_back();
    return handle;
  }
  void give_back(Easy handle) {
    curl_easy_reset(handle.get());
    const std::lock_guard lock(mutex_);
    if (free_.size() < 16) free_.push_back(std::move(handle));
  }

  Headers headers(std::span<const std::byte> body) const {
    Headers all(nullptr, curl_slist_free_all);
    const auto add = [&](const std::string& line) {
      curl_slist* const longer = curl_slist_append(all.get(), line.c_str());
      if (longer == nullptr) throw Error(ErrorCode::kUnavailable, "store: out of memory");
      (void)all.release();
      all.reset(longer);
    };
    add("x-amz-content-sha256: " + to_hex(sha256(body)));
    add("Content-Type: application/octet-stream");
    // No "Expect:" to ask nothing before the bytes: libcurl 7.88 signs it and does not send it.
    if (!options_.session_token.empty()) {
      add("x-amz-security-token: " + options_.session_token);
    }
    return all;
  }

  void prepare(CURL* curl, const char* method, const std::string& url,
               std::span<const std::byte> body) const {
    curl_easy_setopt(curl, CURLOPT_URL, url.c_str());
    curl_easy_setopt(curl, CURLOPT_CUSTOMREQUEST, method);
    curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "http,https");
    curl_easy_setopt(curl, CURLOPT_AWS_SIGV4, ("aws:amz:" + options_.region + ":s3").c_str());
    curl_easy_setopt(curl, CURLOPT_USERNAME, options_.access_key.c_str());
    curl_easy_setopt(curl, CURLOPT_PASSWORD, options_.secret_key.c_str());
    curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT_MS,
                     static_cast<long>(options_.connect_timeout.count()));
    curl_easy_setopt(curl, CURLOPT_TIMEOUT_MS, static_cast<long>(options_.timeout.count()));
    if (std::string_view(method) == "PUT") {
      curl_easy_setopt(curl, CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(body.size()));
      curl_easy_setopt(curl, CURLOPT_POSTFIELDS,
                       body.empty() ? "" : reinterpret_cast<const char*>(body.data()));
    }
  }

  Answer request(const char* method, const std::string& url, std::span<const std::byte> body,
                 std::size_t most) {
    if (const std::string reason = outage_.reason(); !reason.empty()) throw away(reason);
    Easy handle = take_handle();
    if (!handle) throw Error(ErrorCode::kUnavailable, "store: out of memory");
    const Headers lines = headers(body);
    Answer answer;
    answer.most = most;
    prepare(handle.get(), method, url, body);
    curl_easy_setopt(handle.get(), CURLOPT_HTTPHEADER, lines.get());
    curl_easy_setopt(handle.get(), CURLOPT_WRITEFUNCTION, take);
    curl_easy_setopt(handle.get(), CURLOPT_WRITEDATA, &answer);
    const CURLcode code = curl_easy_perform(handle.get());
    curl_easy_getinfo(handle.get(), CURLINFO_RESPONSE_CODE, &answer.status);
    if (code == CURLE_OK) {
      give_back(std::move(handle));
      return answer;
    }
    if (answer.is_too_long) throw too_long();
    if (code == CURLE_PARTIAL_FILE) {
      throw Error(ErrorCode::kCorruptData, "store: an object came shorter than announced");
    }
    outage_.report(curl_easy_strerror(code));
    throw away(curl_easy_strerror(code));
  }

  static Error away(const std::string& why) {
    return Error(ErrorCode::kUnavailable,
                 "store: the object store cannot be reached or is busy; try again (" + why + ")");
  }
  static Error too_long() {
    return Error(ErrorCode::kCorruptData,
                 "store: an object is longer than it may be; restore it from a backup");
  }

  [[noreturn]] static void refuse(const Answer& answer) {
    const std::string code = first_of(answer.text(), "Code");
    const std::string detail =
        "HTTP " + std::to_string(answer.status) + (code.empty() ? "" : " " + code);
    if (answer.status == 429 || answer.status >= 500 || code == "RequestTimeout") {
      throw away(detail);
    }
    if (answer.status == 401 || answer.status == 403 || answer.status == 404 ||
        answer.status == 400 || answer.status == 301) {
      throw Error(ErrorCode::kIo,
                  "store: the object store does not take these keys, or has no such bucket in this "
                  "region; check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, bucket, endpoint and "
                  "region (" +
                      detail + ")");
    }
    throw Error(ErrorCode::kInternal, "store: the object store answered " + detail);
  }

  const ObjectStoreOptions options_;
  const std::string prefix_;
  std::string base_;  ///< URL of the bucket
  DatabaseOutage outage_;
  std::mutex mutex_;
  std::vector<Easy> free_;
};

}  // namespace

std::unique_ptr<ObjectStore> open_object_store(const ObjectStoreOptions& options) {
  options.validate();
  return std::make_unique<S3Store>(options);
}

}  // namespace cellmap
