#include "cellmap/pcl/scan_file.hpp"

#include <pcl/PCLPointCloud2.h>
#include <pcl/console/print.h>
#include <pcl/io/pcd_io.h>
#include <pcl/io/ply_io.h>

#include <cctype>
#include <cstring>
#include <fstream>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/pcl/cloud_header.hpp"

namespace cellmap::pcl_io {
namespace {

namespace fs = std::filesystem;

/// PCL reports on the console and returns -1; a library does not print.
class SilentPcl {
 public:
  SilentPcl() : level_(pcl::console::getVerbosityLevel()) {
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  }
  ~SilentPcl() { pcl::console::setVerbosityLevel(level_); }
  SilentPcl(const SilentPcl&) = delete;
  SilentPcl& operator=(const SilentPcl&) = delete;

 private:
  pcl::console::VERBOSITY_LEVEL level_;
};

enum class CloudFormat { kPcd, kPly };

std::optional<CloudFormat> format_of(const fs::path& file) {
  std::string extension = file.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (extension == ".pcd") return CloudFormat::kPcd;
  if (extension == ".ply") return CloudFormat::kPly;
  return std::nullopt;
}

/// One coordinate of every point.
std::vector<float> column(const fs::path& file, const pcl::PCLPointCloud2& cloud,
                          const char* name) {
  const std::size_t count = static_cast<std::size_t>(cloud.width) * cloud.height;
  for (const pcl::PCLPointField& field : cloud.fields) {
    if (field.name != name) continue;
    const bool is_double = field.datatype == pcl::PCLPointField::FLOAT64;
    const std::size_t bytes = is_double ? sizeof(double) : sizeof(float);
    if ((!is_double && field.datatype != pcl::PCLPointField::FLOAT32) ||
        field.offset + bytes > cloud.point_step || cloud.data.size() / cloud.point_step < count) {
      break;
    }
    std::vector<float> values(count);
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint8_t* at = cloud.data.data() + i * cloud.point_step + field.offset;
      double wide = 0;
      if (is_double) std::memcpy(&wide, at, bytes);
      if (is_double) {
        values[i] = static_cast<float>(wide);
      } else {
        std::memcpy(&values[i], at, bytes);
      }
    }
    return values;
  }
  throw Error(ErrorCode::kCorruptData, file.string() + ": expected a float field " + name +
                                           " for every point, found none after reading");
}

int read_with_pcl(const fs::path& file, CloudFormat format, pcl::PCLPointCloud2& cloud) {
  const SilentPcl silent;
  Eigen::Vector4f origin;
  Eigen::Quaternionf orientation;
  int version = 0;
  if (format == CloudFormat::kPcd) {
    return pcl::PCDReader().read(file.string(), cloud, origin, orientation, version);
  }
  return pcl::PLYReader().read(file.string(), cloud, origin, orientation, version);
}

void add_field(pcl::PCLPointCloud2& cloud, const char* name) {
  pcl::PCLPointField field;
  field.name = name;
  field.offset = cloud.point_step;
  field.datatype = pcl::PCLPointField::FLOAT32;
  field.count = 1;
  cloud.fields.push_back(field);
  cloud.point_step += sizeof(float);
}

pcl::PCLPointCloud2 pcl_cloud(const PointCloud& points, const PointCloud* normals,
                              CloudFormat format) {
  pcl::PCLPointCloud2 cloud;
  cloud.point_step = 0;
  std::vector<const std::vector<float>*> columns = {&points.x, &points.y, &points.z};
  for (const char* name : {"x", "y", "z"}) add_field(cloud, name);
  if (normals != nullptr) {
    // Each format's own convention, the names that viewers look for.
    const bool ply = format == CloudFormat::kPly;
    add_field(cloud, ply ? "nx" : "normal_x");
    add_field(cloud, ply ? "ny" : "normal_y");
    add_field(cloud, ply ? "nz" : "normal_z");
    columns.insert(columns.end(), {&normals->x, &normals->y, &normals->z});
  }
  cloud.width = static_cast<std::uint32_t>(points.size());
  cloud.height = 1;
  cloud.row_step = cloud.point_step * cloud.width;
  cloud.is_bigendian = false;
  cloud.is_dense = false;
  cloud.data.resize(static_cast<std::size_t>(cloud.point_step) * points.size());
  std::uint8_t* out = cloud.data.data();
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (const std::vector<float>* values : columns) {
      std::memcpy(out, &(*values)[i], sizeof(float));
      out += sizeof(float);
    }
  }
  return cloud;
}

/// False where the file could not be written to the end.
bool write_with_pcl(const fs::path& file, CloudFormat format, const pcl::PCLPointCloud2& cloud) {
  const SilentPcl silent;
  const Eigen::Vector4f origin = Eigen::Vector4f::Zero();
  const Eigen::Quaternionf orientation = Eigen::Quaternionf::Identity();
  if (format == CloudFormat::kPcd) {  // PCL's own writer pads the file with zeros to a page
    std::ofstream out(file, std::ios::binary | std::ios::trunc);
    out << pcl::PCDWriter().generateHeaderBinary(cloud, origin, orientation) << "DATA binary\n";
    out.write(reinterpret_cast<const char*>(cloud.data.data()),
              static_cast<std::streamsize>(cloud.data.size()));
    out.close();
    return static_cast<bool>(out);
  }
  // The camera element holds numbers only; without it PCL writes a range grid of lists. Whether the
  // disk was full shows only in the file's size.
  const int result = pcl::PLYWriter().writeBinary(file.string(), cloud, origin, orientation,
                                                  /*use_camera=*/true);
  return result >= 0 && fs::file_size(file) > cloud.data.size();
}

}  // namespace

PointCloud read_scan_file(const fs::path& file) {
  const std::optional<CloudFormat> format = format_of(file);
  if (!format) {
    throw Error(ErrorCode::kUnsupported, file.string() + ": expected a .pcd or .ply file");
  }
  format == CloudFormat::kPcd ? check_pcd(file) : check_ply(file);
  pcl::PCLPointCloud2 cloud;
  std::string reason = "the points do not match the header";
  int result = -1;
  try {
    result = read_with_pcl(file, *format, cloud);
  } catch (const std::exception& error) {
    reason = error.what();
  }
  if (result < 0) {
    throw Error(ErrorCode::kCorruptData, file.string() + ": expected a readable point cloud, " +
                                             "found damaged data (" + reason + ")");
  }
  PointCloud points;
  points.x = column(file, cloud, "x");
  points.y = column(file, cloud, "y");
  points.z = column(file, cloud, "z");
  return points;
}

void write_cloud(const fs::path& file, const PointCloud& points, const PointCloud* normals) {
  const std::optional<CloudFormat> format = format_of(file);
  if (!format) {
    throw Error(ErrorCode::kInvalidArgument,
                file.string() + ": expected a name that ends in .pcd or .ply");
  }
  if (points.empty()) {
    throw Error(ErrorCode::kInvalidArgument,
                file.string() + ": expected points to write, found none");
  }
  if (normals != nullptr && normals->size() != points.size()) {
    throw Error(ErrorCode::kInvalidArgument, file.string() + ": expected a normal for each of " +
                                                 std::to_string(points.size()) + " points, found " +
                                                 std::to_string(normals->size()));
  }
  std::string reason = "does the folder exist, is there space?";
  bool written = false;
  try {
    written = write_with_pcl(file, *format, pcl_cloud(points, normals, *format));
  } catch (const std::exception& error) {
    reason = error.what();
  }
  if (!written) {
    throw Error(ErrorCode::kIo, file.string() + ": cannot be written (" + reason + ")");
  }
}

}  // namespace cellmap::pcl_io
