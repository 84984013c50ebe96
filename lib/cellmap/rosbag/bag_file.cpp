#include "cellmap/rosbag/bag_file.hpp"

#include <array>

#include "cellmap/core/error.hpp"
#include "cellmap/rosbag/byte_reader.hpp"
#include "cellmap/rosbag/decompress.hpp"

// The layout is that of the ROS wiki, "Bags/Format/2.0": records of a header of named fields and of
// data, each with its length before it.

namespace cellmap::ros_bag {
namespace {

constexpr std::string_view kMagic = "#ROSBAG V2.0\n";
constexpr std::size_t kMaxHeaderBytes = 1u << 20;
constexpr std::size_t kMaxChunkBytes = 256u << 20;
constexpr std::size_t kMaxConnections = 100'000;

enum Op : std::uint8_t { kMessage = 2, kBagHeader = 3, kChunk = 5, kConnection = 7 };

Error corrupt(const std::string& message) { return {ErrorCode::kCorruptData, message}; }

std::map<std::string, std::span<const std::byte>> fields_of(std::span<const std::byte> header) {
  std::map<std::string, std::span<const std::byte>> fields;
  ByteReader reader(header);
  while (reader.left() > 0) {
    const auto field = reader.take(reader.number<std::uint32_t>());
    const std::string_view text(reinterpret_cast<const char*>(field.data()), field.size());
    const auto equals = text.find('=');
    if (equals == text.npos) throw corrupt("expected name=value in a record's header");
    fields.insert_or_assign(std::string(text.substr(0, equals)), field.subspan(equals + 1));
  }
  return fields;
}

template <typename Fields>
std::span<const std::byte> field(const Fields& fields, const char* name) {
  const auto found = fields.find(name);
  if (found == fields.end()) throw corrupt("a record lacks its field " + std::string(name));
  return found->second;
}

template <typename Number, typename Fields>
Number number(const Fields& fields, const char* name) {
  const auto bytes = field(fields, name);
  if (bytes.size() != sizeof(Number)) throw corrupt("a record's " + std::string(name) + " is odd");
  return ByteReader(bytes).number<Number>();
}

template <typename Fields>
std::string text(const Fields& fields, const char* name) {
  const auto bytes = field(fields, name);
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace

/// A record of the file; its data is not read yet.
struct BagFile::Record {
  std::vector<std::byte> header_bytes;
  Fields header;
  std::uint64_t data = 0, end = 0;
};

BagFile::BagFile(const std::filesystem::path& file) : file_(file) {
  std::error_code code;
  if (!std::filesystem::exists(file, code)) {
    throw Error(ErrorCode::kNotFound, file.string() + ": expected a ROS 1 bag, found no such file");
  }
  size_ = std::filesystem::file_size(file, code);
  in_.open(file, std::ios::binary);
  if (code || !in_) throw Error(ErrorCode::kIo, file.string() + ": cannot be read");
  std::string magic(kMagic.size(), '\0');
  in_.read(magic.data(), static_cast<std::streamsize>(magic.size()));
  if (magic == kMagic) return;
  throw Error(ErrorCode::kUnsupported,
              file.string() + ": expected a ROS 1 bag of format 2.0, found something else" +
                  (magic.starts_with("#ROSBAG") ? ": rosbag migrates older ones"
                   : magic.starts_with("SQLite") || magic.starts_with("\x89MCAP")
                       ? ": this is a ROS 2 bag, which rosbags-convert turns into one"
                       : ""));
}

std::optional<BagFile::Record> BagFile::read_record(std::uint64_t at) {
  if (at == size_) return std::nullopt;
  const auto length_at = [&](std::uint64_t position) {
    std::array<std::byte, 4> bytes{};
    in_.clear();
    in_.seekg(static_cast<std::streamoff>(position));
    in_.read(reinterpret_cast<char*>(bytes.data()), bytes.size());
    if (!in_) throw corrupt("it ends within a record: rosbag reindex or fix mends what can be");
    return ByteReader(bytes).number<std::uint32_t>();
  };
  Record record;
  const std::uint32_t header_bytes = length_at(at);
  if (header_bytes > kMaxHeaderBytes || header_bytes > size_ - at) {
    throw corrupt("a record's header is longer than it can be");
  }
  record.header_bytes.resize(header_bytes);
  in_.read(reinterpret_cast<char*>(record.header_bytes.data()), header_bytes);
  record.header = fields_of(record.header_bytes);
  record.data = at + 4 + header_bytes + 4;
  record.end = record.data + length_at(at + 4 + header_bytes);
  if (record.end > size_) {
    throw corrupt("it ends within a record: rosbag reindex or fix mends what can be");
  }
  return record;
}

void BagFile::take_connection(const Fields& header, std::span<const std::byte> data) {
  Connection connection{text(header, "topic"), text(fields_of(data), "type")};
  connections_.insert_or_assign(number<std::uint32_t>(header, "conn"), std::move(connection));
  if (connections_.size() > kMaxConnections) {
    throw Error(ErrorCode::kTooLarge,
                "it has more than " + std::to_string(kMaxConnections) + " connections");
  }
}

void BagFile::open_chunk(std::uint64_t at) {
  if (chunk_at_ == at) return;
  chunk_at_.reset();
  const auto record = read_record(at);
  if (!record || number<std::uint8_t>(record->header, "op") != kChunk) {
    throw corrupt("expected a chunk where there was one: the file changed");
  }
  const std::uint64_t bytes = record->end - record->data;
  const std::uint32_t size = number<std::uint32_t>(record->header, "size");
  if (bytes > kMaxChunkBytes || size > kMaxChunkBytes) {
    throw Error(ErrorCode::kTooLarge, "a chunk has more than 256 MiB");
  }
  std::vector<std::byte> packed(bytes);
  in_.seekg(static_cast<std::streamoff>(record->data));
  in_.read(reinterpret_cast<char*>(packed.data()), static_cast<std::streamsize>(bytes));
  if (!in_) throw Error(ErrorCode::kIo, "a chunk cannot be read");
  chunk_ = decompress_chunk(packed, text(record->header, "compression"), size);
  chunk_end_ = record->end;
  chunk_at_ = at;
}

std::span<const std::byte> BagFile::message(MessagePlace place) try {
  open_chunk(place.chunk);
  ByteReader reader(chunk_);
  reader.take(place.offset);
  reader.take(reader.number<std::uint32_t>());
  return reader.take(reader.number<std::uint32_t>());
} catch (const Error& error) {
  throw Error(error.code(), file_.string() + ": " + error.what());
}

void BagFile::for_each_message(const std::function<void(const Connection&, MessagePlace,
                                                        std::span<const std::byte>)>& visit) try {
  for (std::uint64_t at = kMagic.size();;) {
    const auto record = read_record(at);
    if (!record) return;
    const auto op = number<std::uint8_t>(record->header, "op");
    if (op == kBagHeader && record->header.contains("encryptor") &&
        !record->header.at("encryptor").empty()) {
      throw Error(ErrorCode::kUnsupported, "it is encrypted: rosbag decrypts it");
    }
    if (op == kChunk) {
      open_chunk(at);
      ByteReader reader(chunk_);
      while (reader.left() > 0) {
        const MessagePlace place{at, chunk_.size() - reader.left()};
        const Fields header = fields_of(reader.take(reader.number<std::uint32_t>()));
        const auto data = reader.take(reader.number<std::uint32_t>());
        const auto inner = number<std::uint8_t>(header, "op");
        if (inner == kConnection) take_connection(header, data);
        if (inner != kMessage) continue;
        const auto sender = connections_.find(number<std::uint32_t>(header, "conn"));
        if (sender == connections_.end()) throw corrupt("a message is nobody's");
        visit(sender->second, place, data);
      }
    }
    at = record->end;
  }
} catch (const Error& error) {
  throw Error(error.code(), file_.string() + ": " + error.what());
}

}  // namespace cellmap::ros_bag
