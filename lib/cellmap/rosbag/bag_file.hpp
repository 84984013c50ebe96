#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace cellmap::ros_bag {

/// Who sent messages: a topic and the type of its messages, "sensor_msgs/PointCloud2".
struct Connection {
  std::string topic, type;
};

/// Where a message lies: its chunk in the file, and the message in the chunk.
struct MessagePlace {
  std::uint64_t chunk = 0;
  std::size_t offset = 0;
};

/// A ROS 1 bag (format 2.0, compressed chunks too), read from its first to its last record. It is
/// not trusted: every length is held against the bytes that are there before anything is read or
/// allocated, and a chunk has at most 256 MiB. Its index is not used, so a bag that lacks it is
/// read too. Memory: one chunk. Not thread safe.
class BagFile {
 public:
  /// Throws Error{kNotFound}, {kIo}, {kUnsupported} for bags of another format or encrypted ones.
  explicit BagFile(const std::filesystem::path& file);

  /// Calls `visit` for every message in the order of the file; its bytes are good during the call.
  /// Throws Error{kCorruptData}, {kUnsupported}, {kTooLarge} with the file's name. O(bytes).
  void for_each_message(const std::function<void(const Connection&, MessagePlace,
                                                 std::span<const std::byte>)>& visit);

  /// The message at a place that `for_each_message` told; good until the next call.
  std::span<const std::byte> message(MessagePlace place);

 private:
  using Fields = std::map<std::string, std::span<const std::byte>>;
  struct Record;

  std::optional<Record> read_record(std::uint64_t at);
  void open_chunk(std::uint64_t at);
  void take_connection(const Fields& header, std::span<const std::byte> data);

  std::filesystem::path file_;
  std::uint64_t size_ = 0;
  std::ifstream in_;
  std::map<std::uint32_t, Connection> connections_;  ///< that were met
  std::optional<std::uint64_t> chunk_at_;            ///< of the chunk that is open
  std::uint64_t chunk_end_ = 0;                      ///< in the file
  std::vector<std::byte> chunk_;                     ///< its content
};

}  // namespace cellmap::ros_bag
