#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <string>
#include <string_view>

namespace cellmap::server {

using Clock = std::chrono::steady_clock;

struct ConnectionLimits {
  std::chrono::milliseconds read_timeout{30'000};   ///< of a body, and 1 s more for every
  std::chrono::milliseconds write_timeout{10'000};  ///< of an answer, and 1 s more for every
  std::size_t slowest_bytes_per_s = 4096;           ///< bytes of progress; who is slower is cut off
};

/// A socket, what came from it and was not read yet, and what is still to be sent. Belongs to one
/// thread at a time: to the loop of the front while it is parked, to a worker while it is served.
class Connection {
 public:
  /// Takes the socket. `stop` ends waits for the peer.
  Connection(int socket, const ConnectionLimits& limits, const std::atomic<bool>& stop);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  int socket() const { return socket_; }
  /// Of the peer: an IPv4 address, the network of an IPv6 one ("2001:db8:1:2::/64", which one host
  /// may have whole), or "unix".
  const std::string& address() const;

  /// Takes what the socket has, up to 64 kB at a time, without waiting. False where the peer has
  /// closed or the connection is broken.
  bool receive();
  std::string_view input() const { return std::string_view(input_).substr(begin_); }
  /// These first bytes of the input were read. Views of it hold until more is received.
  void skip(std::size_t size) { begin_ += size; }

  /// Before a request is read and answered: with `patient`, a worker may wait for the peer to take
  /// the answer; else what the socket does not take at once is left for `send_pending`.
  void begin(bool patient);

  /// Reads up to `size` > 0 bytes, waiting for them; 0: the peer closed, was too slow or the server
  /// stops. Sends first what was written, which is what the peer waits for ("100 Continue").
  std::size_t read(char* data, std::size_t size);
  /// Small pieces are joined and sent together. False where the connection is broken.
  bool write(std::string_view data);
  /// As `write`, of bytes that are in a file too, from `offset` on: what the socket takes at once
  /// is sent from there, without a copy.
  bool write_of_file(std::string_view data, int file, std::size_t offset);
  bool flush();

  /// Every piece goes at once from here on, as an event stream needs it.
  void send_at_once() { at_once_ = true; }

  std::size_t pending() const { return output_.size() - sent_; }
  /// Sends without waiting what is pending. False where the connection is broken.
  bool send_pending();

  /// No more will be sent; the peer may still be sending.
  void half_close();
  /// Throws away what came. False where the peer has closed.
  bool discard();
  /// True where the peer has closed its side, or the connection is broken.
  bool is_closed_by_peer() const;
  /// The server stops: what has no end of its own ends.
  bool is_stopping() const { return stop_; }

 private:
  bool wait(short events, Clock::time_point deadline) const;
  bool send_now(std::string_view first, std::string_view second, std::size_t& sent);
  bool send_before_more();
  bool send_with_output(std::string_view data);
  Clock::time_point slowest(Clock::time_point start, std::chrono::milliseconds timeout,
                            std::size_t bytes) const;

  int socket_;
  const ConnectionLimits& limits_;
  const std::atomic<bool>& stop_;
  mutable std::string address_;  ///< once it was asked for
  std::string input_;
  std::size_t begin_ = 0;  ///< of what was not read yet
  std::string output_;
  std::size_t sent_ = 0;  ///< of output_
  bool patient_ = false, at_once_ = false;
  Clock::time_point start_;         ///< of the request
  std::size_t bytes_received_ = 0;  ///< since then
};

}  // namespace cellmap::server
