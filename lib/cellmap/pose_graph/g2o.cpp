#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <span>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "cellmap/pose_graph/start.hpp"

namespace cellmap {
namespace {

constexpr double kLargestCoordinateM = 1e8;
constexpr std::size_t kMostRecords = 5'000'000;

void append(std::string& text, double value) {
  std::array<char, 32> buffer;
  const auto [end, error] = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  text.append(1, ' ').append(buffer.data(), end);
}

void append(std::string& text, const Pose& T) {
  for (const double value : to_xyz_qxyzw(T)) append(text, value);
}

/// Splits a text into lines and a line into fields.
class LineReader {
 public:
  explicit LineReader(std::string_view text) : rest_(text) {}

  bool next() {
    if (rest_.empty()) return false;
    const std::size_t end = std::min(rest_.find('\n'), rest_.size());
    line_ = rest_.substr(0, end);
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    ++number_;
    return true;
  }

  /// The next word of the line; empty at its end.
  std::string_view word() {
    constexpr std::string_view kBlanks = " \t\r";
    line_.remove_prefix(std::min(line_.find_first_not_of(kBlanks), line_.size()));
    const std::string_view found = line_.substr(0, line_.find_first_of(kBlanks));
    line_.remove_prefix(found.size());
    return found;
  }

  template <typename Number>
  Number number() {
    const std::string_view field = word();
    Number value{};
    const auto [end, error] = std::from_chars(field.data(), field.data() + field.size(), value);
    if (error != std::errc() || end != field.data() + field.size() || field.empty()) {
      refuse("expected a number, found '" + std::string(field.substr(0, 40)) + "'");
    }
    return value;
  }

  double coordinate() {
    const double value = number<double>();
    if (!(std::abs(value) <= kLargestCoordinateM)) refuse("a coordinate is beyond 1e8 m");
    return value;
  }

  CellId id() { return CellId{number<std::uint32_t>()}; }

  Pose pose() {
    std::array<double, 7> values;
    for (double& value : values) value = coordinate();
    // Some writers leave the quaternion unnormalised in the last digits; a zero one is still
    // refused.
    const double norm = std::sqrt(values[3] * values[3] + values[4] * values[4] +
                                  values[5] * values[5] + values[6] * values[6]);
    if (!(std::abs(norm - 1.0) < 0.05)) refuse("the quaternion's norm is not 1");
    for (std::size_t i = 3; i < 7; ++i) values[i] /= norm;
    try {
      return pose_from_xyz_qxyzw(values);
    } catch (const Error& error) {
      refuse(error.what());
    }
  }

  /// x, y and heading.
  Pose planar_pose() {
    const double x = coordinate(), y = coordinate(), heading = coordinate();
    Pose T = Pose::Identity();
    T.translation() << x, y, 0;
    T.rotate(Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()));
    return T;
  }

  template <int Size>
  Eigen::Matrix<double, Size, Size> upper_triangle() {
    Eigen::Matrix<double, Size, Size> M;
    for (int row = 0; row < Size; ++row) {
      for (int column = row; column < Size; ++column) {
        M(row, column) = M(column, row) = number<double>();
      }
    }
    return M;
  }

  void end() {
    if (!word().empty()) refuse("expected the end of the line");
  }

  [[noreturn]] void refuse(const std::string& why) const {
    throw Error(ErrorCode::kCorruptData, "g2o line " + std::to_string(number_) + ": " + why);
  }

 private:
  std::string_view rest_, line_;
  std::size_t number_ = 0;
};

/// g2o perturbs a measurement from the right, T * exp(xi); ours is exp(xi) * T with
/// xi_left = adjoint(T) * xi_right, hence information_right = Ad(T)^T * information_left * Ad(T).
Matrix6d right_from_left(const Matrix6d& information, const Pose& T) {
  const Matrix6d Ad = adjoint(T);
  return Ad.transpose() * information * Ad;
}

Matrix6d left_from_right(const Matrix6d& information, const Pose& T) {
  return right_from_left(information, T.inverse());
}

/// In Ceres' example errors are those of the position in the axes of `from` and, with the sign
/// turned, of the rotation: (rho + phi x t, -phi) of the left perturbation. And it whitens with the
/// factor L of L * L^T, where L^T were right, so that its matrix is L^T * L.
Matrix6d left_from_ceres(const Matrix6d& file, const Pose& T) {
  const Matrix6d L = file.llt().matrixL();
  const Matrix6d information = L.transpose() * L;
  Matrix6d error_from_left = Matrix6d::Identity();
  error_from_left.topRightCorner<3, 3>() = -skew(T.translation());
  error_from_left.bottomRightCorner<3, 3>() *= -1;
  return error_from_left.transpose() * information * error_from_left;
}

/// The two axes and the heading of the plane as measured; what the plane leaves open as certain as
/// the means of those, and consistent, so that nothing leaves the plane.
Matrix6d lifted(const Eigen::Matrix3d& planar) {
  constexpr std::array<int, 3> kPlanar{0, 1, 5};
  Matrix6d information = Matrix6d::Zero();
  information(2, 2) = 0.5 * (planar(0, 0) + planar(1, 1));
  information(3, 3) = information(4, 4) = planar(2, 2);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      information(kPlanar[row], kPlanar[column]) = planar(row, column);
    }
  }
  return information;
}

Constraint read_edge(LineReader& line, bool is_planar, G2oInformation meaning) {
  Constraint edge;
  edge.from = line.id();
  edge.to = line.id();
  edge.T_from_to = is_planar ? line.planar_pose() : line.pose();
  const Matrix6d information =
      is_planar ? lifted(line.upper_triangle<3>()) : line.upper_triangle<6>();
  line.end();
  edge.information = meaning == G2oInformation::kRightPerturbation
                         ? left_from_right(information, edge.T_from_to)
                         : left_from_ceres(information, edge.T_from_to);
  edge.information = 0.5 * (edge.information + edge.information.transpose()).eval();
  const bool consecutive = edge.to.value == edge.from.value + 1;
  edge.kind = consecutive ? ConstraintKind::kOdometry : ConstraintKind::kLoop;
  try {
    validate(edge);
  } catch (const Error& error) {
    line.refuse(error.what());
  }
  return edge;
}

void read_record(LineReader& line, G2oInformation meaning, PoseGraph& graph) {
  const std::string_view tag = line.word();
  const bool is_planar = tag.ends_with("_SE2");
  if (tag == "VERTEX_SE3:QUAT" || tag == "VERTEX_SE2") {
    const CellId id = line.id();
    const Pose T = is_planar ? line.planar_pose() : line.pose();
    line.end();
    if (!graph.nodes.emplace(id, T).second) {
      line.refuse("vertex " + std::to_string(id.value) + " is there twice");
    }
  } else if (tag == "EDGE_SE3:QUAT" || tag == "EDGE_SE2") {
    graph.constraints.push_back(read_edge(line, is_planar, meaning));
    graph.constraints.back().id = {static_cast<std::uint32_t>(graph.constraints.size())};
  } else if (tag.starts_with("VERTEX_") || tag.starts_with("EDGE_")) {
    line.refuse("'" + std::string(tag.substr(0, 40)) +
                "' is not supported; expected poses in SE3:QUAT or SE2");
  }
  if (graph.nodes.size() + graph.constraints.size() > kMostRecords) {
    line.refuse("more than 5 million records");
  }
}

}  // namespace

std::string to_g2o(const PoseGraph& graph) {
  std::string text;
  for (const auto& [id, T] : graph.nodes) {
    text += "VERTEX_SE3:QUAT " + std::to_string(id.value);
    append(text, T);
    text += '\n';
  }
  for (const Constraint& edge : graph.constraints) {
    text +=
        "EDGE_SE3:QUAT " + std::to_string(edge.from.value) + ' ' + std::to_string(edge.to.value);
    append(text, edge.T_from_to);
    const Matrix6d information = right_from_left(edge.information, edge.T_from_to);
    for (int row = 0; row < 6; ++row) {
      for (int column = row; column < 6; ++column) append(text, information(row, column));
    }
    text += '\n';
  }
  return text;
}

PoseGraph pose_graph_from_g2o(std::string_view text, G2oInformation meaning) {
  PoseGraph graph;
  LineReader line(text);
  while (line.next()) read_record(line, meaning, graph);
  const bool has_poses = !graph.nodes.empty();
  for (const Constraint& edge : graph.constraints) {
    for (const CellId id : {edge.from, edge.to}) {
      if (has_poses && !graph.nodes.contains(id)) {
        throw Error(ErrorCode::kCorruptData,
                    "g2o: the edge from " + std::to_string(edge.from.value) + " to " +
                        std::to_string(edge.to.value) + " names vertex " +
                        std::to_string(id.value) + ", which is not in the file");
      }
      graph.nodes.try_emplace(id, Pose::Identity());
    }
  }
  if (!has_poses) graph.nodes = spanning_tree_start(graph);
  return graph;
}

}  // namespace cellmap
