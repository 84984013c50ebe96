#include "cellmap/pose_graph/start.hpp"

#include <Eigen/SVD>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/components.hpp"

namespace cellmap {
namespace {

/// A constraint between positions in the list of nodes, with scalar weights.
struct Edge {
  std::size_t from, to;
  const Pose* T_from_to;
  double rotation_weight, translation_weight;
  bool is_trusted;
};

/// The graph by positions instead of ids.
struct IndexedGraph {
  std::vector<CellId> ids;  // ascending
  std::vector<Pose> poses;
  std::vector<Edge> edges;
  std::vector<bool> is_fixed;  // the lowest node of each component

  explicit IndexedGraph(const PoseGraph& graph);
  std::map<CellId, Pose> by_id() const;
};

std::size_t index_of(const std::vector<CellId>& ids, CellId id) {
  const auto found = std::lower_bound(ids.begin(), ids.end(), id);
  if (found == ids.end() || *found != id) {
    throw Error(ErrorCode::kInvalidArgument, "a constraint names CELL " + std::to_string(id.value) +
                                                 ", which is not in the pose graph");
  }
  return static_cast<std::size_t>(found - ids.begin());
}

IndexedGraph::IndexedGraph(const PoseGraph& graph) {
  for (const auto& [id, T] : graph.nodes) {
    ids.push_back(id);
    poses.push_back(T);
  }
  Components components(ids.size());
  for (const Constraint& c : graph.constraints) {
    const std::size_t from = index_of(ids, c.from), to = index_of(ids, c.to);
    const double weight = is_trusted(c) ? 1.0 : c.weight;
    if (weight == 0) continue;
    // About the measured position, where rotation and translation are hardly coupled.
    Matrix6d A = Matrix6d::Identity();
    A.topRightCorner<3, 3>() = skew(c.T_from_to.translation());
    const Matrix6d information = weight * (A.transpose() * c.information * A);
    edges.push_back({from, to, &c.T_from_to, information.diagonal().tail<3>().mean(),
                     information.diagonal().head<3>().mean(), is_trusted(c)});
    components.join(from, to);
  }
  for (std::size_t i = 0; i < ids.size(); ++i) is_fixed.push_back(components.lowest(i) == i);
}

std::map<CellId, Pose> IndexedGraph::by_id() const {
  std::map<CellId, Pose> nodes;
  for (std::size_t i = 0; i < ids.size(); ++i) nodes.emplace_hint(nodes.end(), ids[i], poses[i]);
  return nodes;
}

/// For each node the edges of a forest that prefers trusted ones.
std::vector<std::vector<const Edge*>> forest(const IndexedGraph& graph) {
  std::vector<std::vector<const Edge*>> edges_of(graph.ids.size());
  Components joined(graph.ids.size());
  for (const bool trusted : {true, false}) {
    for (const Edge& edge : graph.edges) {
      if (edge.is_trusted != trusted || !joined.join(edge.from, edge.to)) continue;
      edges_of[edge.from].push_back(&edge);
      edges_of[edge.to].push_back(&edge);
    }
  }
  return edges_of;
}

/// Normal equations of a chordal problem: unknown blocks of `Size` numbers a free node.
template <int Size>
class BlockSystem {
 public:
  using Block = Eigen::Matrix<double, Size, Size>;
  using Rows = Eigen::Matrix<double, Size, 3>;

  explicit BlockSystem(const std::vector<bool>& is_fixed) {
    for (const bool fixed : is_fixed) column_.push_back(fixed ? -1 : Size * free_++);
    right_ = Eigen::MatrixXd::Zero(Eigen::Index{Size} * free_, 3);
  }

  /// Adds weight * |X_to - B * X_from - offset|^2, where X of a fixed node is the value given and B
  /// is orthogonal.
  void add(const Edge& edge, double weight, const Block& B, const Rows& offset,
           const Rows& fixed_from, const Rows& fixed_to) {
    const int from = column_[edge.from], to = column_[edge.to];
    if (from >= 0) diagonal(from, weight);
    if (to >= 0) diagonal(to, weight);
    if (from >= 0 && to >= 0) off_diagonal(from, to, -weight * B);
    if (to >= 0) {
      right_.middleRows<Size>(to) += weight * offset;
      if (from < 0) right_.middleRows<Size>(to) += weight * (B * fixed_from);
    }
    if (from >= 0) {
      right_.middleRows<Size>(from) -= weight * (B.transpose() * offset);
      if (to < 0) right_.middleRows<Size>(from) += weight * (B.transpose() * fixed_to);
    }
  }

  void solve() {
    Eigen::SparseMatrix<double> H(right_.rows(), right_.rows());
    H.setFromTriplets(entries_.begin(), entries_.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> ldlt(H);
    if (ldlt.info() != Eigen::Success) {
      throw Error(ErrorCode::kInvalidArgument,
                  "no chordal start: the constraints leave a rotation or position undetermined");
    }
    right_ = ldlt.solve(right_).eval();
  }

  bool is_free(std::size_t node) const { return column_[node] >= 0; }
  Rows solution(std::size_t node) const { return right_.middleRows<Size>(column_[node]); }

 private:
  void diagonal(int column, double weight) {
    for (int i = 0; i < Size; ++i) entries_.emplace_back(column + i, column + i, weight);
  }
  /// d^2 / dX_to dX_from, stored in the lower triangle.
  void off_diagonal(int from, int to, const Block& M) {
    for (int i = 0; i < Size; ++i) {
      for (int k = 0; k < Size; ++k) {
        const int row = to + i, column = from + k;
        entries_.emplace_back(std::max(row, column), std::min(row, column), M(i, k));
      }
    }
  }

  std::vector<int> column_;  // -1: fixed
  int free_ = 0;
  std::vector<Eigen::Triplet<double>> entries_;
  Eigen::MatrixXd right_;
};

Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& M) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(M, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign(1, 1, 1);
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) sign.z() = -1;
  return svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
}

/// The unknown of a node is R^T, so that R_to = R_from * M reads X_to = M^T * X_from.
void solve_rotations(IndexedGraph& graph) {
  BlockSystem<3> system(graph.is_fixed);
  for (const Edge& edge : graph.edges) {
    system.add(edge, edge.rotation_weight, edge.T_from_to->linear().transpose(),
               Eigen::Matrix3d::Zero(), graph.poses[edge.from].linear().transpose(),
               graph.poses[edge.to].linear().transpose());
  }
  system.solve();
  for (std::size_t i = 0; i < graph.poses.size(); ++i) {
    if (!system.is_free(i)) continue;
    graph.poses[i].linear() = nearest_rotation(system.solution(i).transpose());
  }
}

/// The unknown of a node is its position as a row; t_to = t_from + R_from * m.
void solve_positions(IndexedGraph& graph) {
  BlockSystem<1> system(graph.is_fixed);
  for (const Edge& edge : graph.edges) {
    const Pose &from = graph.poses[edge.from], &to = graph.poses[edge.to];
    system.add(edge, edge.translation_weight, Eigen::Matrix<double, 1, 1>::Ones(),
               (from.linear() * edge.T_from_to->translation()).transpose(),
               from.translation().transpose(), to.translation().transpose());
  }
  system.solve();
  for (std::size_t i = 0; i < graph.poses.size(); ++i) {
    if (system.is_free(i)) graph.poses[i].translation() = system.solution(i).transpose();
  }
}

}  // namespace

std::map<CellId, Pose> spanning_tree_start(const PoseGraph& given) {
  IndexedGraph graph(given);
  const auto edges_of = forest(graph);
  std::vector<bool> placed = graph.is_fixed;
  std::vector<std::size_t> queue;
  for (std::size_t i = 0; i < placed.size(); ++i) {
    if (placed[i]) queue.push_back(i);
  }
  for (std::size_t next = 0; next < queue.size(); ++next) {
    const std::size_t i = queue[next];
    for (const Edge* edge : edges_of[i]) {
      const std::size_t other = edge->from == i ? edge->to : edge->from;
      if (placed[other]) continue;
      graph.poses[other] =
          graph.poses[i] * (edge->from == i ? *edge->T_from_to : edge->T_from_to->inverse());
      placed[other] = true;
      queue.push_back(other);
    }
  }
  return graph.by_id();
}

std::map<CellId, Pose> chordal_start(const PoseGraph& given) {
  IndexedGraph graph(given);
  solve_rotations(graph);
  solve_positions(graph);
  return graph.by_id();
}

}  // namespace cellmap
