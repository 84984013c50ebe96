#include "server/audit_log.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>

#include "cellmap/core/error.hpp"
#include "server/api/json_io.hpp"

namespace cellmap::server {
namespace {

Stamp now() {
  const auto since = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(since).count();
}

std::string line_of(const AuditEntry& entry) {
  Json json{{"time", to_rfc3339(now())},
            {"request_id", entry.request_id},
            {"caller", nullptr},
            {"address", entry.address},
            {"method", entry.method},
            {"path", entry.path},
            {"map", nullptr},
            {"status", entry.status}};
  if (!entry.caller.empty()) json["caller"] = entry.caller;
  if (!entry.map.empty()) json["map"] = entry.map;
  if (!entry.code.empty()) json["code"] = entry.code;
  return dump(json) + "\n";
}

}  // namespace

AuditLog::AuditLog(std::filesystem::path file) : file_(std::move(file)), descriptor_(open_file()) {}
AuditLog::~AuditLog() { ::close(descriptor_); }

int AuditLog::open_file() const {
  const int descriptor =
      ::open(file_.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (descriptor < 0) {
    throw Error(ErrorCode::kIo,
                "Cannot write the audit log " + file_.string() + ": " + std::strerror(errno) + ".");
  }
  return descriptor;
}

void AuditLog::reopen() {
  const std::lock_guard lock(mutex_);
  const int descriptor = open_file();
  ::close(std::exchange(descriptor_, descriptor));
}

void AuditLog::write(const AuditEntry& entry) {
  const std::string line = line_of(entry);
  const std::lock_guard lock(mutex_);
  // At once: with O_APPEND a line is whole even where another process writes to the file.
  const ssize_t written = ::write(descriptor_, line.data(), line.size());
  if (written != static_cast<ssize_t>(line.size())) {
    throw Error(ErrorCode::kIo, "Cannot write the audit log " + file_.string() + ": " +
                                    (written < 0 ? std::strerror(errno) : "the disk is full") +
                                    ".");
  }
}

}  // namespace cellmap::server
