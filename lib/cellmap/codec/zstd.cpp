#include "cellmap/codec/zstd.hpp"

#include <zstd.h>

#include <algorithm>
#include <memory>
#include <new>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

Error corrupt_frame(const std::string& what) {
  return Error(ErrorCode::kCorruptData, "the bytes are no single zstd frame: " + what);
}

bool starts_with_zstd_magic(std::span<const std::byte> frame) {
  constexpr std::byte kMagic[] = {std::byte{0x28}, std::byte{0xB5}, std::byte{0x2F},
                                  std::byte{0xFD}};
  return frame.size() >= sizeof(kMagic) &&
         std::equal(std::begin(kMagic), std::end(kMagic), frame.begin());
}

/// Looks only at headers: costs microseconds however much a frame claims to hold.
std::size_t declared_size(std::span<const std::byte> frame, std::size_t max_size) {
  // Skippable and legacy frames have another magic number.
  if (!starts_with_zstd_magic(frame)) throw corrupt_frame("the magic number is not 28 B5 2F FD");
  const unsigned long long declared = ZSTD_getFrameContentSize(frame.data(), frame.size());
  if (declared == ZSTD_CONTENTSIZE_ERROR) throw corrupt_frame("the frame header is damaged");
  if (declared == ZSTD_CONTENTSIZE_UNKNOWN)
    throw corrupt_frame("the frame does not declare its content size");
  if (declared > max_size) {
    throw Error(ErrorCode::kTooLarge, "a zstd frame declares " + std::to_string(declared) +
                                          " bytes, but at most " + std::to_string(max_size) +
                                          " are allowed here");
  }
  const std::size_t frame_size = ZSTD_findFrameCompressedSize(frame.data(), frame.size());
  if (ZSTD_isError(frame_size)) throw corrupt_frame(ZSTD_getErrorName(frame_size));
  if (frame_size != frame.size()) {
    throw corrupt_frame("the frame ends after " + std::to_string(frame_size) + " of " +
                        std::to_string(frame.size()) + " bytes");
  }
  return static_cast<std::size_t>(declared);
}

}  // namespace

Bytes zstd_compress(std::span<const std::byte> data, int level) {
  if (level < 1 || level > ZSTD_maxCLevel()) {
    throw Error(ErrorCode::kInvalidArgument, "a zstd level is 1 to " +
                                                 std::to_string(ZSTD_maxCLevel()) + ", but " +
                                                 std::to_string(level) + " was given");
  }
  const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                     ZSTD_freeCCtx);
  if (!context) throw std::bad_alloc();
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, level);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_contentSizeFlag, 1);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
  Bytes frame(ZSTD_compressBound(data.size()));
  const std::size_t size =
      ZSTD_compress2(context.get(), frame.data(), frame.size(), data.data(), data.size());
  if (ZSTD_isError(size)) {
    throw Error(ErrorCode::kInternal,
                std::string("zstd could not compress: ") + ZSTD_getErrorName(size));
  }
  frame.resize(size);
  return frame;
}

Bytes zstd_decompress(std::span<const std::byte> frame, std::size_t max_size) {
  Bytes data(declared_size(frame, max_size));
  const std::size_t size = ZSTD_decompress(data.data(), data.size(), frame.data(), frame.size());
  if (ZSTD_isError(size)) throw corrupt_frame(ZSTD_getErrorName(size));
  if (size != data.size()) {
    throw corrupt_frame("it declares " + std::to_string(data.size()) + " bytes, but holds " +
                        std::to_string(size));
  }
  return data;
}

}  // namespace cellmap
