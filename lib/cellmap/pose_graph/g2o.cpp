#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <span>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {
namespace {

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

  CellId id() { return CellId{number<std::uint32_t>()}; }

  Pose pose() {
    std::array<double, 7> values;
    for (double& value : values) value = number<double>();
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

  Matrix6d upper_triangle() {
    Matrix6d M;
    for (int row = 0; row < 6; ++row) {
      for (int column = row; column < 6; ++column) {
        M(row, column) = M(column, row) = number<double>();
      }
    }
    return M;
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

Constraint read_edge(LineReader& line) {
  Constraint edge;
  edge.from = line.id();
  edge.to = line.id();
  edge.T_from_to = line.pose();
  edge.information = left_from_right(line.upper_triangle(), edge.T_from_to);
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

PoseGraph pose_graph_from_g2o(std::string_view text) {
  PoseGraph graph;
  LineReader line(text);
  while (line.next()) {
    const std::string_view tag = line.word();
    if (tag == "VERTEX_SE3:QUAT") {
      const CellId id = line.id();
      if (!graph.nodes.emplace(id, line.pose()).second) {
        line.refuse("vertex " + std::to_string(id.value) + " is there twice");
      }
    } else if (tag == "EDGE_SE3:QUAT") {
      graph.constraints.push_back(read_edge(line));
      graph.constraints.back().id = {static_cast<std::uint32_t>(graph.constraints.size())};
    }
  }
  for (const Constraint& edge : graph.constraints) {
    if (!graph.nodes.contains(edge.from) || !graph.nodes.contains(edge.to)) {
      throw Error(ErrorCode::kCorruptData, "g2o: the edge from " + std::to_string(edge.from.value) +
                                               " to " + std::to_string(edge.to.value) +
                                               " names a vertex that is not in the file");
    }
  }
  return graph;
}

}  // namespace cellmap
