#include "cellmap/store/row_codec.hpp"

#include <bit>
#include <cstring>

#include "cellmap/core/error.hpp"
#include "cellmap/store/validation.hpp"

namespace cellmap {
namespace {

static_assert(std::endian::native == std::endian::little, "rows are little-endian");

constexpr std::size_t kScanBytes = 8 + 12 * sizeof(double);

[[noreturn]] void corrupt(const char* what) {
  throw Error(ErrorCode::kCorruptData,
              std::string("store: a ") + what + " is damaged; restore the file from a backup");
}

class Writer {
 public:
  explicit Writer(std::size_t size) { bytes_.reserve(size); }

  template <typename Value>
  void put(Value value) {
    const auto raw = std::bit_cast<std::array<std::byte, sizeof(Value)>>(value);
    bytes_.insert(bytes_.end(), raw.begin(), raw.end());
  }

  template <typename Matrix>
  void put_matrix(const Matrix& matrix) {
    for (Eigen::Index row = 0; row < matrix.rows(); ++row) {
      for (Eigen::Index column = 0; column < matrix.cols(); ++column) put(matrix(row, column));
    }
  }

  Bytes take() { return std::move(bytes_); }

 private:
  Bytes bytes_;
};

class Reader {
 public:
  Reader(std::span<const std::byte> bytes, std::size_t expected, const char* what) : bytes_(bytes) {
    if (bytes.size() != expected) corrupt(what);
  }

  template <typename Value>
  Value get() {
    Value value;
    std::memcpy(&value, bytes_.data(), sizeof(Value));
    bytes_ = bytes_.subspan(sizeof(Value));
    return value;
  }

  template <typename Matrix>
  Matrix get_matrix() {
    Matrix matrix;
    for (Eigen::Index row = 0; row < matrix.rows(); ++row) {
      for (Eigen::Index column = 0; column < matrix.cols(); ++column) {
        matrix(row, column) = get<double>();
      }
    }
    return matrix;
  }

 private:
  std::span<const std::byte> bytes_;
};

using Matrix34d = Eigen::Matrix<double, 3, 4>;

Pose checked(const Pose& pose) {
  if (!is_storable(pose)) corrupt("pose");
  return pose;
}

Pose pose_from_matrix(const Matrix34d& matrix) {
  Pose pose = Pose::Identity();
  pose.matrix().topRows<3>() = matrix;
  return checked(pose);
}

}  // namespace

Bytes pose_to_bytes(const Pose& pose) {
  Writer writer(12 * sizeof(double));
  writer.put_matrix(Matrix34d(pose.matrix().topRows<3>()));
  return writer.take();
}

Pose pose_from_bytes(std::span<const std::byte> bytes) {
  return pose_from_matrix(Reader(bytes, 12 * sizeof(double), "pose").get_matrix<Matrix34d>());
}

Bytes rotation_to_bytes(const Pose& pose) {
  Writer writer(9 * sizeof(double));
  writer.put_matrix(Eigen::Matrix3d(pose.linear()));
  return writer.take();
}

Pose pose_from_columns(const Eigen::Vector3d& position, std::span<const std::byte> rotation) {
  Pose pose = Pose::Identity();
  pose.linear() = Reader(rotation, 9 * sizeof(double), "rotation").get_matrix<Eigen::Matrix3d>();
  pose.translation() = position;
  return checked(pose);
}

Bytes information_to_bytes(const Matrix6d& information) {
  Writer writer(36 * sizeof(double));
  writer.put_matrix(information);
  return writer.take();
}

Matrix6d information_from_bytes(std::span<const std::byte> bytes) {
  const auto information =
      Reader(bytes, 36 * sizeof(double), "information matrix").get_matrix<Matrix6d>();
  if (!information.allFinite()) corrupt("information matrix");
  return information;
}

Bytes scores_to_bytes(const RegistrationScores& scores) {
  Writer writer(48);
  writer.put(scores.points);
  writer.put(scores.hits);
  writer.put(scores.inlier_ratio_all);
  writer.put(scores.inlier_ratio_hit);
  writer.put(scores.share_in_front);
  writer.put(scores.share_beyond);
  writer.put(scores.median_residual_m);
  return writer.take();
}

RegistrationScores scores_from_bytes(std::span<const std::byte> bytes) {
  Reader reader(bytes, 48, "set of scores");
  RegistrationScores scores;
  scores.points = reader.get<std::uint32_t>();
  scores.hits = reader.get<std::uint32_t>();
  scores.inlier_ratio_all = reader.get<double>();
  scores.inlier_ratio_hit = reader.get<double>();
  scores.share_in_front = reader.get<double>();
  scores.share_beyond = reader.get<double>();
  scores.median_residual_m = reader.get<double>();
  return scores;
}

Bytes scans_to_bytes(std::span<const ScanInCell> scans) {
  Writer writer(scans.size() * kScanBytes);
  for (const ScanInCell& scan : scans) {
    writer.put(scan.stamp);
    writer.put_matrix(Matrix34d(scan.T_cell_scan.matrix().topRows<3>()));
  }
  return writer.take();
}

std::vector<ScanInCell> scans_from_bytes(std::span<const std::byte> bytes) {
  const std::size_t count = bytes.size() / kScanBytes;
  Reader reader(bytes, count * kScanBytes, "list of scans");
  std::vector<ScanInCell> scans(count);
  for (ScanInCell& scan : scans) {
    scan.stamp = reader.get<Stamp>();
    scan.T_cell_scan = pose_from_matrix(reader.get_matrix<Matrix34d>());
  }
  return scans;
}

}  // namespace cellmap
