#pragma once

#include <filesystem>
#include <mutex>
#include <string>

namespace cellmap::server {

/// One write that was asked for.
struct AuditEntry {
  std::string request_id;
  std::string caller;   ///< name of the token; "" without one
  std::string address;  ///< where it came from
  std::string method, path;
  std::string map;  ///< where the path names one
  int status = 0;
  std::string code;  ///< of the problem, where there was one
};

/// Who changed what, and whether they might: a file of JSON lines, to which lines are only added.
/// Each is written whole before its request is answered. Thread safe.
class AuditLog {
 public:
  /// Makes the file, mode 0600, where it is missing. Throws Error{kIo}.
  explicit AuditLog(std::filesystem::path file);
  ~AuditLog();
  AuditLog(const AuditLog&) = delete;
  AuditLog& operator=(const AuditLog&) = delete;

  /// Throws Error{kIo}.
  void write(const AuditEntry& entry);
  /// After the file was moved away: begins a new one. Throws Error{kIo}, and keeps the old one.
  void reopen();

 private:
  int open_file() const;

  const std::filesystem::path file_;
  std::mutex mutex_;
  int descriptor_;
};

}  // namespace cellmap::server
