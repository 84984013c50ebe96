#include "server/auth/token_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>

#include "cellmap/core/error.hpp"

namespace cellmap::auth {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kBlank = " \t\r";
constexpr double kMaxRate = 1e6;

[[noreturn]] void fail(const fs::path& file, const std::string& what) {
  throw Error(ErrorCode::kIo,
              "Cannot " + what + " " + file.string() + ": " + std::strerror(errno) + ".");
}

class Descriptor {
 public:
  explicit Descriptor(int value) : value_(value) {}
  ~Descriptor() {
    if (value_ >= 0) ::close(value_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  operator int() const { return value_; }

 private:
  int value_;
};

/// Parts between any of `separators`; empty ones are left out.
std::vector<std::string_view> parts_of(std::string_view text, std::string_view separators) {
  std::vector<std::string_view> parts;
  for (;;) {
    const auto begin = text.find_first_not_of(separators);
    if (begin == text.npos) return parts;
    text.remove_prefix(begin);
    const auto end = std::min(text.find_first_of(separators), text.size());
    parts.push_back(text.substr(0, end));
    text.remove_prefix(end);
  }
}

/// Reads one line; `refuse` throws with its place.
class LineReader {
 public:
  LineReader(const std::string& file, std::size_t line)
      : where_(file + ":" + std::to_string(line)) {}

  Token read(const std::vector<std::string_view>& words) const {
    if (words.size() < 3) refuse("expected NAME sha256:HASH SCOPES, found fewer words");
    Token token;
    token.name = words[0];
    if (!is_token_name(token.name)) {
      refuse("expected a name of 1 to 64 letters, digits, '.', '_' or '-'");
    }
    token.hash = hash(words[1]);
    for (const auto text : parts_of(words[2], ",")) {
      const auto scope = scope_from_string(text);
      if (!scope)
        refuse("there is no scope " + quoted(text) +
               "; there are map:read, map:write, relocalise and admin");
      token.scopes.insert(*scope);
    }
    if (token.scopes.empty()) refuse("expected at least one scope");
    for (std::size_t i = 3; i < words.size(); ++i) read_limit(words[i], token);
    return token;
  }

  [[noreturn]] void refuse(const std::string& why) const {
    throw Error(ErrorCode::kInvalidArgument, where_ + ": " + why + ".");
  }

 private:
  static std::string quoted(std::string_view text) {
    std::string shown;
    for (const char c : text.substr(0, 60)) shown += c > ' ' && c < 0x7f ? c : '?';
    return "'" + shown + "'";
  }

  ContentHash hash(std::string_view text) const {
    constexpr std::string_view kPrefix = "sha256:";
    if (text.starts_with(kPrefix)) {
      try {
        return content_hash_from_hex(std::string(text.substr(kPrefix.size())));
      } catch (const Error&) {
        // Not with the text: it may be a secret that was put here by mistake.
      }
    }
    refuse("expected sha256: and 64 hexadecimal digits after the name");
  }

  void read_limit(std::string_view word, Token& token) const {
    const auto equals = word.find('=');
    const auto key = word.substr(0, equals);
    const auto value = equals == word.npos ? std::string_view() : word.substr(equals + 1);
    if (value.empty()) refuse("expected KEY=VALUE, found " + quoted(word));
    if (key == "maps" && token.maps.empty()) {
      for (const auto map : parts_of(value, ",")) token.maps.emplace(map);
      if (token.maps.empty()) refuse("expected names of maps after maps=");
    } else if (key == "expires" && !token.expires) {
      token.expires = time_from_text(value);
      if (!token.expires) refuse("expected a time such as 2027-01-31T00:00:00Z after expires=");
    } else if (key == "rate" && !token.requests_per_s) {
      double rate = -1;
      const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), rate);
      const bool whole = error == std::errc() && end == value.data() + value.size();
      if (!whole || !std::isfinite(rate) || rate < 0 || rate > kMaxRate) {
        refuse("expected requests a second from 0 to 1000000 after rate=");
      }
      token.requests_per_s = rate;
    } else {
      refuse("expected maps=, expires= or rate=, each once, found " + quoted(word));
    }
  }

  std::string where_;
};

std::vector<std::string_view> words_of(std::string_view line) {
  return parts_of(line.substr(0, line.find('#')), kBlank);
}

void check_owner(const fs::path& file, const struct stat& status) {
  if (!S_ISREG(status.st_mode)) {
    throw Error(ErrorCode::kInvalidArgument, file.string() + " is no file.");
  }
  if ((status.st_mode & 077) != 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "Others than its owner may use the token file " + file.string() +
                    ": expected mode 0600. Say: chmod 600 " + file.string());
  }
  if (status.st_uid != ::geteuid() && status.st_uid != 0 && ::geteuid() != 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "The token file " + file.string() + " belongs to somebody else.");
  }
  if (status.st_size > static_cast<off_t>(kMaxTokenFileBytes)) {
    throw Error(ErrorCode::kTooLarge, file.string() + " has more than 1 MiB.");
  }
}

/// The checked content of a file that is there.
std::string read_text(const fs::path& file, struct stat& status) {
  const Descriptor descriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (descriptor < 0 && errno == ENOENT) {
    throw Error(ErrorCode::kNotFound, "There is no token file " + file.string() +
                                          "; make one with: cellmap token create NAME --tokens " +
                                          file.string() + " --scope map:read");
  }
  if (descriptor < 0 || ::fstat(descriptor, &status) != 0) fail(file, "read");
  check_owner(file, status);
  std::string text(kMaxTokenFileBytes + 1, '\0');
  std::size_t size = 0;
  while (size < text.size()) {
    const ssize_t got = ::read(descriptor, text.data() + size, text.size() - size);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail(file, "read");
    if (got == 0) break;
    size += static_cast<std::size_t>(got);
  }
  text.resize(size);
  return text;
}

void write_all(int descriptor, std::string_view text, const fs::path& file) {
  while (!text.empty()) {
    const ssize_t written = ::write(descriptor, text.data(), text.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail(file, "write");
    text.remove_prefix(static_cast<std::size_t>(written));
  }
}

/// A file whose editors wait for one another.
class EditedFile {
 public:
  explicit EditedFile(const fs::path& file)
      : file_(fs::weakly_canonical(file)),
        folder_(::open(file_.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    if (folder_ < 0 || ::flock(folder_, LOCK_EX) != 0) fail(file_.parent_path(), "open the folder");
    if (fs::exists(file_)) {
      text_ = read_text(file_, status_);
      exists_ = true;
    }
  }

  const std::string& text() const { return text_; }
  const fs::path& path() const { return file_; }

  void replace(std::string_view text) const {
    const fs::path next = file_.string() + ".new";
    ::unlink(next.c_str());
    const Descriptor descriptor(
        ::open(next.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600));
    if (descriptor < 0) fail(next, "write");
    // Root may edit, or make, the file of the user that the server runs as.
    struct stat owner = status_;
    if (!exists_) ::fstat(folder_, &owner);
    const bool is_ours = owner.st_uid == ::geteuid() || (!exists_ && ::geteuid() != 0);
    if (!is_ours && ::fchown(descriptor, owner.st_uid, owner.st_gid) != 0) {
      fail(next, "give its owner");
    }
    write_all(descriptor, text, next);
    if (::fsync(descriptor) != 0 || ::rename(next.c_str(), file_.c_str()) != 0) {
      fail(file_, "replace");
    }
    ::fsync(folder_);
  }

 private:
  fs::path file_;
  Descriptor folder_;
  struct stat status_ {};
  std::string text_;
  bool exists_ = false;
};

}  // namespace

std::vector<Token> parse_tokens(std::string_view text, const std::string& file) {
  std::vector<Token> tokens;
  for (std::size_t line = 1; !text.empty(); ++line) {
    const auto end = std::min(text.find('\n'), text.size());
    const auto words = words_of(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    if (words.empty()) continue;
    const LineReader reader(file, line);
    Token token = reader.read(words);
    for (const Token& other : tokens) {
      if (other.name == token.name) reader.refuse("the name " + token.name + " comes twice");
      if (other.hash == token.hash) reader.refuse("the secret of " + other.name + " comes twice");
    }
    if (tokens.size() == kMaxTokens) {
      reader.refuse("more than " + std::to_string(kMaxTokens) + " tokens");
    }
    tokens.push_back(std::move(token));
  }
  return tokens;
}

std::string to_line(const Token& token) {
  std::string line = token.name + " sha256:" + to_hex(token.hash) + " ";
  for (const Scope scope : token.scopes) {
    line.append(scope == *token.scopes.begin() ? "" : ",").append(to_string(scope));
  }
  for (const auto& map : token.maps) line += (map == *token.maps.begin() ? " maps=" : ",") + map;
  if (token.expires) line += " expires=" + to_text(*token.expires);
  if (token.requests_per_s) {
    char rate[32];
    const auto written = std::to_chars(rate, rate + sizeof(rate), *token.requests_per_s);
    line += " rate=" + std::string(rate, written.ptr);
  }
  return line + "\n";
}

std::vector<Token> read_token_file(const fs::path& file) {
  struct stat status {};
  return parse_tokens(read_text(file, status), file.string());
}

void add_token(const fs::path& file, const Token& token) {
  const EditedFile edited(file);
  for (const Token& other : parse_tokens(edited.text(), file.string())) {
    if (other.name == token.name) {
      throw Error(ErrorCode::kAlreadyExists,
                  "There is a token " + token.name + " already; revoke it first.");
    }
  }
  std::string text = edited.text();
  if (!text.empty() && !text.ends_with('\n')) text += '\n';
  text += to_line(token);
  parse_tokens(text, file.string());  // nothing is written that a server would refuse
  edited.replace(text);
}

void remove_token(const fs::path& file, const std::string& name) {
  const EditedFile edited(file);
  parse_tokens(edited.text(), file.string());
  std::string kept;
  bool found = false;
  for (std::string_view rest = edited.text(); !rest.empty();) {
    const auto size = std::min(rest.find('\n'), rest.size() - 1) + 1;
    const auto words = words_of(rest.substr(0, size));
    const bool is_it = !words.empty() && words[0] == name;
    found |= is_it;
    if (!is_it) kept += rest.substr(0, size);
    rest.remove_prefix(size);
  }
  if (!found) {
    throw Error(ErrorCode::kNotFound, "There is no token " + name + " in " + file.string() + ".");
  }
  edited.replace(kept);
}

}  // namespace cellmap::auth
