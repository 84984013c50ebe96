#include "cellmap/export/point_file.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kTextHeaderBytes = 512;
constexpr std::size_t kLasHeaderBytes = 227;
constexpr std::uint16_t kLasPointBytes = 20;
constexpr double kLasScaleM = 0.001;

/// Fills a text header up to its fixed length with a comment before `last_line`.
std::string filled(std::string header, const std::string& comment, const std::string& last_line) {
  header += comment;
  header.append(kTextHeaderBytes - header.size() - last_line.size() - 1, '.');
  return header + "\n" + last_line;
}

std::string ply_header(std::uint64_t points) {
  return filled(
      "ply\nformat binary_little_endian 1.0\ncomment CELLmap, map frame, metres\n"
      "element vertex " +
          std::to_string(points) +
          "\nproperty float x\nproperty float y\nproperty float z\n"
          "property float nx\nproperty float ny\nproperty float nz\n",
      "comment ", "end_header\n");
}

template <typename Number>
void put(std::string& bytes, Number value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
}

void put_text(std::string& bytes, std::string text, std::size_t length) {
  text.resize(length, '\0');
  bytes += text;
}

/// LAS 1.2, public header block (ASPRS, Version 1.2, table 2); bounds are max and min by axis.
std::string las_header(std::uint64_t points, const std::array<double, 3>& low,
                       const std::array<double, 3>& high) {
  std::string bytes = "LASF";
  put<std::uint16_t>(bytes, 0);  // source
  put<std::uint16_t>(bytes, 0);  // global encoding
  bytes.append(16, '\0');        // project id
  put<std::uint8_t>(bytes, 1);   // version 1.2
  put<std::uint8_t>(bytes, 2);
  put_text(bytes, "EXTRACTION", 32);
  put_text(bytes, "CELLmap", 32);
  put<std::uint16_t>(bytes, 0);  // day and year of creation: the same map gives the same file
  put<std::uint16_t>(bytes, 0);
  put<std::uint16_t>(bytes, kLasHeaderBytes);
  put<std::uint32_t>(bytes, kLasHeaderBytes);  // offset to the points
  put<std::uint32_t>(bytes, 0);                // variable length records
  put<std::uint8_t>(bytes, 0);                 // point format
  put<std::uint16_t>(bytes, kLasPointBytes);
  put<std::uint32_t>(bytes, static_cast<std::uint32_t>(points));
  put<std::uint32_t>(bytes, static_cast<std::uint32_t>(points));  // by return: all are first ones
  for (int k = 1; k < 5; ++k) put<std::uint32_t>(bytes, 0);
  for (int axis = 0; axis < 3; ++axis) put<double>(bytes, kLasScaleM);
  for (int axis = 0; axis < 3; ++axis) put<double>(bytes, 0);  // offsets
  for (int axis = 0; axis < 3; ++axis) {
    put<double>(bytes, points == 0 ? 0 : high[axis]);
    put<double>(bytes, points == 0 ? 0 : low[axis]);
  }
  return bytes;
}

std::string las_rows(const PointCloud& points) {
  std::string bytes;
  bytes.reserve(points.size() * kLasPointBytes);
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (const float value : {points.x[i], points.y[i], points.z[i]}) {
      const double steps = std::round(value / kLasScaleM);
      if (!(std::abs(steps) <= std::numeric_limits<std::int32_t>::max())) {
        throw Error(ErrorCode::kTooLarge,
                    "LAS to a millimetre reaches 2,147 km from the map's origin; the map does not");
      }
      put(bytes, static_cast<std::int32_t>(steps));
    }
    put<std::uint16_t>(bytes, 0);    // intensity
    put<std::uint8_t>(bytes, 0x09);  // the first return of one
    bytes.append(3, '\0');           // classification, scan angle, user data
    put<std::uint16_t>(bytes, 0);    // source
  }
  return bytes;
}

}  // namespace

PointFormat point_format_of(const fs::path& file) {
  const std::string extension = file.extension().string();
  if (extension == ".ply") return PointFormat::kPly;
  if (extension == ".pcd") return PointFormat::kPcd;
  if (extension == ".las") return PointFormat::kLas;
  throw Error(ErrorCode::kInvalidArgument,
              "expected a name that ends in .ply, .pcd or .las, not '" + file.string() + "'");
}

std::string pcd_header(std::uint64_t points) {
  const std::string count = std::to_string(points);
  // The comment stands before the first field, where every reader skips it.
  std::string fields =
      "VERSION 0.7\nFIELDS x y z normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4\nTYPE F F F F F F\n"
      "COUNT 1 1 1 1 1 1\nWIDTH " +
      count + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + count + "\nDATA binary\n";
  return filled("# .PCD v0.7 - Point Cloud Data file format\n", "# CELLmap, map frame, metres ",
                fields);
}

std::string float_rows(const PointCloud& points, const PointCloud& normals) {
  std::string bytes;
  bytes.reserve(points.size() * 6 * sizeof(float));
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (const float value :
         {points.x[i], points.y[i], points.z[i], normals.x[i], normals.y[i], normals.z[i]}) {
      put(bytes, value);
    }
  }
  return bytes;
}

PointFileWriter::PointFileWriter(const fs::path& file, PointFormat format)
    : file_(file), part_(file.string() + ".part"), format_(format) {
  low_.fill(std::numeric_limits<double>::infinity());
  high_.fill(-std::numeric_limits<double>::infinity());
  out_.open(part_, std::ios::binary | std::ios::trunc);
  out_ << header();
  if (!out_) throw Error(ErrorCode::kIo, part_.string() + ": cannot be written");
}

PointFileWriter::~PointFileWriter() {
  if (finished_) return;
  out_.close();
  std::error_code ignored;
  fs::remove(part_, ignored);
}

std::string PointFileWriter::header() const {
  if (format_ == PointFormat::kPly) return ply_header(points_);
  if (format_ == PointFormat::kPcd) return pcd_header(points_);
  return las_header(points_, low_, high_);
}

void PointFileWriter::add(const PointCloud& points, const PointCloud& normals) {
  const std::string rows =
      format_ == PointFormat::kLas ? las_rows(points) : float_rows(points, normals);
  points_ += points.size();
  if (format_ == PointFormat::kLas && points_ > std::numeric_limits<std::uint32_t>::max()) {
    throw Error(ErrorCode::kTooLarge,
                "LAS 1.2 holds 4,294,967,295 points; take a lower density, PLY or tiles");
  }
  const std::array axes = {&points.x, &points.y, &points.z};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const float value : *axes[axis]) {
      const double kept = std::round(value / kLasScaleM) * kLasScaleM;
      low_[axis] = std::min(low_[axis], kept);
      high_[axis] = std::max(high_[axis], kept);
    }
  }
  out_.write(rows.data(), static_cast<std::streamsize>(rows.size()));
  if (!out_) throw Error(ErrorCode::kIo, part_.string() + ": cannot be written; is there space?");
}

void PointFileWriter::finish() {
  out_.seekp(0);
  out_ << header();
  out_.close();
  std::error_code failed;
  if (out_) fs::rename(part_, file_, failed);
  if (!out_ || failed) throw Error(ErrorCode::kIo, file_.string() + ": cannot be written");
  finished_ = true;
}

}  // namespace cellmap
