#pragma once

namespace cellmap::server {

/// A file descriptor that is closed.
class Descriptor {
 public:
  /// Throws Error{kIo} for one that could not be made.
  explicit Descriptor(int value);
  ~Descriptor();
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  int value() const { return value_; }

 private:
  const int value_;
};

}  // namespace cellmap::server
