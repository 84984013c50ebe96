#include "cellmap/client/range_source.hpp"

#include <charconv>

#include "cellmap/client/files.hpp"
#include "cellmap/client/transport.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

using client::HttpRequest;
using client::HttpResponse;

/// "bytes 0-99/1234" as first byte and total.
struct ContentRange {
  std::uint64_t begin = 0, total = 0;
};

std::optional<ContentRange> parse_content_range(const std::string& text) {
  ContentRange range;
  std::uint64_t last = 0;
  const char* at = text.data();
  const char* const end = at + text.size();
  const auto number = [&](std::uint64_t& value, char after) {
    const auto parsed = std::from_chars(at, end, value);
    const bool good =
        parsed.ec == std::errc() &&
        (after == '\0' ? parsed.ptr == end : parsed.ptr != end && *parsed.ptr == after);
    at = good && after != '\0' ? parsed.ptr + 1 : parsed.ptr;
    return good;
  };
  if (!text.starts_with("bytes ")) return std::nullopt;
  at += 6;
  const bool good = number(range.begin, '-') && number(last, '/') && number(range.total, '\0');
  return good ? std::optional(range) : std::nullopt;
}

class HttpFile : public ByteSource {
 public:
  HttpFile(const std::string& url, const std::string& path, const ClientOptions& options)
      : url_(url), path_(path), transport_(options) {}

  Bytes read(std::uint64_t offset, std::size_t length) override {
    if (length == 0 || (size_ && offset >= *size_)) return {};
    HttpRequest request{"GET", path_, {}, ""};
    request.headers["range"] =
        "bytes=" + std::to_string(offset) + "-" + std::to_string(offset + length - 1);
    request.headers["accept-encoding"] = "identity";
    if (!etag_.empty()) {
      request.headers["if-match"] = etag_;
    } else if (!modified_.empty()) {
      request.headers["if-unmodified-since"] = modified_;
    }
    request.max_answer_bytes = length;
    const HttpResponse response = perform(request);
    const auto range = parse_content_range(response.header("content-range"));
    if (response.status != 206 || !range || range->begin != offset) throw no_ranges();
    remember(response, range->total);
    const auto bytes = client::as_bytes(response.body);
    const std::uint64_t expected = std::min<std::uint64_t>(length, range->total - offset);
    if (bytes.size() != expected) {
      throw Error(ErrorCode::kIo, url_ + ": the answer ended early; try again");
    }
    return Bytes(bytes.begin(), bytes.end());
  }

  std::uint64_t size() override {
    if (!size_) read(0, 1);
    return *size_;
  }

  void restart() override {
    size_.reset();
    etag_.clear();
    modified_.clear();
  }

  std::string name() const override { return url_; }

 private:
  Error no_ranges() const {
    return Error(ErrorCode::kUnsupported,
                 "the web server of " + url_ +
                     " does not send parts of files (HTTP Range); fetch "
                     "the whole file and name that, or use another server");
  }

  HttpResponse perform(const HttpRequest& request) {
    try {
      return transport_.perform(request);
    } catch (const Error& error) {
      // The whole file instead of a part; it is not read to its end.
      if (error.code() == ErrorCode::kTooLarge) throw no_ranges();
      throw;
    }
  }

  void remember(const HttpResponse& response, std::uint64_t total) {
    // A weak tag does not tell whether bytes are equal.
    std::string etag = response.header("etag");
    if (etag.starts_with("W/")) etag.clear();
    const std::string modified = response.header("last-modified");
    if (!size_) {
      size_ = total;
      etag_ = etag;
      modified_ = modified;
    } else if (total != *size_ || etag != etag_ || modified != modified_) {
      throw Error(ErrorCode::kPreconditionFailed, url_ + " was replaced while it was read");
    }
  }

  std::string url_, path_;
  client::Transport transport_;
  std::optional<std::uint64_t> size_;  ///< of the file that is read
  std::string etag_, modified_;        ///< its validators; empty: none
};

}  // namespace

bool is_http_url(const std::string& text) {
  return text.starts_with("http://") || text.starts_with("https://");
}

std::unique_ptr<ByteSource> open_http_file(const std::string& url, ClientOptions options) {
  const std::size_t host = url.find("://");
  const std::size_t slash = host == std::string::npos ? host : url.find('/', host + 3);
  if (slash == std::string::npos) {
    throw Error(ErrorCode::kInvalidArgument,
                "'" + url + "' is no address of a file; expected http://HOST:PORT/PATH");
  }
  options.url = url.substr(0, slash);
  options.validate();
  return std::make_unique<HttpFile>(url, url.substr(slash), options);
}

}  // namespace cellmap
