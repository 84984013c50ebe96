#include "cellmap/codec/verified_buffer.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cstring>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/schema/common_generated.h"

namespace cellmap {
namespace {

static_assert(std::endian::native == std::endian::little,
              "arrays are copied as they lie in a file");
static_assert(sizeof(schema::Pose) == 96 && sizeof(schema::Hash256) == 32,
              "a struct of the format has changed: every file would become unreadable");

constexpr std::size_t kAlignment = 8;  // of the largest number
constexpr std::size_t kIdentifierPosition = 4;
constexpr std::size_t kMaxDepth = 16;

Error corrupt_buffer(const BufferKind& kind, const std::string& what) {
  return Error(ErrorCode::kCorruptData, std::string("the bytes are no ") + kind.name + ": " + what);
}

flatbuffers::Verifier verifier_of(std::span<const std::byte> bytes, std::size_t max_tables) {
  return flatbuffers::Verifier(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(),
                               kMaxDepth, static_cast<flatbuffers::uoffset_t>(max_tables));
}

void check_identifier(std::span<const std::byte> bytes, const BufferKind& kind) {
  if (bytes.size() < 2 * kIdentifierPosition) {
    throw corrupt_buffer(kind, "expected at least 8 bytes, found " + std::to_string(bytes.size()));
  }
  std::string found(reinterpret_cast<const char*>(bytes.data()) + kIdentifierPosition, 4);
  if (found == kind.identifier) return;
  std::replace_if(
      found.begin(), found.end(), [](unsigned char c) { return !std::isprint(c); }, '?');
  throw corrupt_buffer(kind, std::string("expected the identifier '") + kind.identifier +
                                 "', found '" + found + "'");
}

/// Before the structure is judged by the rules of this version.
void check_version(std::span<const std::byte> bytes, const BufferKind& kind) {
  flatbuffers::Verifier verifier = verifier_of(bytes, 1);
  if (!verifier.VerifyBuffer<schema::Versioned>(kind.identifier)) {
    throw corrupt_buffer(kind, "the root table is damaged");
  }
  const auto version = flatbuffers::GetRoot<schema::Versioned>(bytes.data())->version();
  if (version == 0) throw corrupt_buffer(kind, "it has no format version");
  if (version != kFormatVersion) {
    throw Error(ErrorCode::kUnsupported,
                std::string("this ") + kind.name + " has the format version " +
                    std::to_string(version) + ", but this build reads version " +
                    std::to_string(kFormatVersion) + "; update CELLmap to read it");
  }
}

}  // namespace

void check_size(std::span<const std::byte> bytes, const BufferKind& kind) {
  if (bytes.size() > kind.max_bytes) {
    throw Error(ErrorCode::kTooLarge, std::string("a ") + kind.name + " has at most " +
                                          std::to_string(kind.max_bytes) + " bytes, but " +
                                          std::to_string(bytes.size()) + " were given");
  }
}

bool is_aligned(std::span<const std::byte> bytes) {
  return reinterpret_cast<std::uintptr_t>(bytes.data()) % kAlignment == 0;
}

void verify_buffer(std::span<const std::byte> bytes, const BufferKind& kind,
                   std::size_t max_tables) {
  check_size(bytes, kind);
  check_identifier(bytes, kind);
  check_version(bytes, kind);
  flatbuffers::Verifier verifier = verifier_of(bytes, max_tables);
  if (!kind.verify(verifier)) {
    throw corrupt_buffer(kind, "a field is missing, or an offset or a length leads out of the " +
                                   std::to_string(bytes.size()) + " bytes");
  }
}

Bytes verified_copy(std::span<const std::byte> bytes, const BufferKind& kind,
                    std::size_t max_tables) {
  check_size(bytes, kind);  // before so much is copied
  Bytes copy(bytes.begin(), bytes.end());
  verify_buffer(copy, kind, max_tables);
  return copy;
}

schema::Pose pose_to_wire(const Pose& T) {
  return {T(0, 0), T(0, 1), T(0, 2), T(0, 3), T(1, 0), T(1, 1),
          T(1, 2), T(1, 3), T(2, 0), T(2, 1), T(2, 2), T(2, 3)};
}

Pose pose_from_wire(const schema::Pose* wire, const char* name) {
  Eigen::Matrix<double, 3, 4, Eigen::RowMajor> M;
  static_assert(sizeof(M) == sizeof(schema::Pose));
  // The verifier does not check the alignment of structs in vectors.
  std::memcpy(M.data(), static_cast<const void*>(wire), sizeof(M));
  Pose T = Pose::Identity();
  T.linear() = M.leftCols<3>();
  T.translation() = M.col(3);
  if (!is_rigid(T)) {
    throw Error(ErrorCode::kCorruptData,
                std::string(name) + " is not a rigid transform of finite numbers");
  }
  return T;
}

}  // namespace cellmap
