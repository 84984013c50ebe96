#include "cellmap/pose_graph/chains.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/components.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kMostLoops = 300;
constexpr std::size_t kSeeds = 20;

/// Directions of no information count as this much less certain than the best.
constexpr double kLeastRelativeInformation = 1e-9;

Matrix6d covariance(const Matrix6d& information) {
  const double floor = kLeastRelativeInformation * information.diagonal().maxCoeff();
  return (information + floor * Matrix6d::Identity()).ldlt().solve(Matrix6d::Identity());
}

/// `covariance` of a left perturbation in the frame T_a_b's b, seen in a.
Matrix6d carried(const Pose& T_a_b, const Matrix6d& covariance) {
  const Matrix6d Ad = adjoint(T_a_b);
  return Ad * covariance * Ad.transpose();
}

/// A breadth-first forest over the trusted constraints, with the covariance that grows along it.
class TrustedForest {
 public:
  explicit TrustedForest(const PoseGraph& graph) {
    for (const auto& [id, T] : graph.nodes) {
      ids_.push_back(id);
      poses_.push_back(T);
    }
    std::vector<std::vector<const Constraint*>> edges_of(ids_.size());
    for (const Constraint& c : graph.constraints) {
      const std::size_t from = position(c.from), to = position(c.to);
      if (!is_trusted(c)) continue;
      edges_of[from].push_back(&c);
      edges_of[to].push_back(&c);
    }
    nodes_.resize(ids_.size());
    for (std::size_t i = 0; i < ids_.size(); ++i) {
      if (!nodes_[i].is_placed) grow(i, edges_of);
    }
  }

  std::size_t position(CellId id) const {
    const auto found = std::lower_bound(ids_.begin(), ids_.end(), id);
    if (found == ids_.end() || *found != id) {
      throw Error(ErrorCode::kInvalidArgument, "a constraint names CELL " +
                                                   std::to_string(id.value) +
                                                   ", which is not in the pose graph");
    }
    return static_cast<std::size_t>(found - ids_.begin());
  }

  std::size_t size() const { return ids_.size(); }
  std::size_t root(std::size_t node) const { return nodes_[node].root; }
  const Pose& pose(std::size_t node) const { return poses_[node]; }

  /// Of the pose of one node relative to another of its chain, in the map's frame.
  Matrix6d covariance_between(std::size_t a, std::size_t b) const {
    const std::size_t meet = last_common(a, b);
    return nodes_[a].covariance + nodes_[b].covariance - 2 * nodes_[meet].covariance;
  }

 private:
  struct Node {
    bool is_placed = false;
    std::size_t root = 0, parent = 0, depth = 0;
    Matrix6d covariance = Matrix6d::Zero();  // to the root
  };

  void grow(std::size_t root, const std::vector<std::vector<const Constraint*>>& edges_of) {
    nodes_[root].is_placed = true;
    nodes_[root].root = nodes_[root].parent = root;
    std::vector<std::size_t> queue{root};
    for (std::size_t next = 0; next < queue.size(); ++next) {
      const std::size_t i = queue[next];
      for (const Constraint* edge : edges_of[i]) {
        const std::size_t from = position(edge->from);
        const std::size_t child = from == i ? position(edge->to) : from;
        if (nodes_[child].is_placed) continue;
        nodes_[child] = {
            true, root, i, nodes_[i].depth + 1,
            nodes_[i].covariance + carried(poses_[from], covariance(edge->information))};
        queue.push_back(child);
      }
    }
  }

  std::size_t last_common(std::size_t a, std::size_t b) const {
    while (a != b) {
      if (nodes_[a].depth < nodes_[b].depth) std::swap(a, b);
      a = nodes_[a].parent;
    }
    return a;
  }

  std::vector<CellId> ids_;  // ascending
  std::vector<Pose> poses_;
  std::vector<Node> nodes_;
};

/// A loop from the chain of the lower root to the other, as the motion of the other chain that
/// would fulfil it.
struct Link {
  std::size_t near, far;  ///< nodes
  Pose motion;            ///< T_map_near * T_near_far * T_map_far^-1
  Matrix6d covariance;    ///< of the loop, in the map's frame
};

Link link(const TrustedForest& forest, const Constraint& loop) {
  std::size_t near = forest.position(loop.from), far = forest.position(loop.to);
  Pose T_near_far = loop.T_from_to;
  const Matrix6d in_map =
      carried(forest.pose(near), covariance(loop.information));  // about the side of `from`
  if (forest.root(far) < forest.root(near)) {
    std::swap(near, far);
    T_near_far = loop.T_from_to.inverse();
  }
  Link link{near, far, forest.pose(near) * T_near_far * forest.pose(far).inverse(), in_map};
  // The error of a loop measured from the far side is moved along with that chain.
  if (near != forest.position(loop.from)) link.covariance = carried(link.motion, in_map);
  return link;
}

/// Squared Mahalanobis length of the cycle through two links.
double disagreement(const TrustedForest& forest, const Link& a, const Link& b) {
  const Tangent error = log(a.motion * b.motion.inverse());
  const Matrix6d far = carried(a.motion, forest.covariance_between(a.far, b.far));
  const Matrix6d sum =
      a.covariance + b.covariance + forest.covariance_between(a.near, b.near) + far;
  return error.dot(sum.ldlt().solve(error));
}

using Agreement = std::vector<std::vector<char>>;

Agreement agreement(const TrustedForest& forest, const std::vector<Link>& links, double scale) {
  Agreement agree(links.size(), std::vector<char>(links.size(), 0));
  for (std::size_t a = 0; a < links.size(); ++a) {
    for (std::size_t b = a + 1; b < links.size(); ++b) {
      agree[a][b] = agree[b][a] = disagreement(forest, links[a], links[b]) <= scale * scale;
    }
  }
  return agree;
}

/// A clique that holds `seed`: again and again the candidate that most other candidates agree with.
std::vector<std::size_t> clique_around(const Agreement& agree, std::size_t seed) {
  std::vector<std::size_t> clique{seed}, candidates;
  for (std::size_t i = 0; i < agree.size(); ++i) {
    if (agree[seed][i]) candidates.push_back(i);
  }
  while (!candidates.empty()) {
    const auto partners = [&](std::size_t i) {
      return std::count_if(candidates.begin(), candidates.end(),
                           [&](std::size_t k) { return agree[i][k]; });
    };
    std::size_t best = candidates.front();
    auto most = partners(best);
    for (const std::size_t i : candidates) {
      if (const auto count = partners(i); count > most) best = i, most = count;
    }
    clique.push_back(best);
    std::erase_if(candidates, [&](std::size_t i) { return !agree[best][i]; });
  }
  std::sort(clique.begin(), clique.end());
  return clique;
}

std::vector<std::size_t> largest_clique(const Agreement& agree) {
  std::vector<std::pair<std::ptrdiff_t, std::size_t>> seeds;  // most partners first
  for (std::size_t i = 0; i < agree.size(); ++i) {
    seeds.emplace_back(-std::count(agree[i].begin(), agree[i].end(), 1), i);
  }
  std::sort(seeds.begin(), seeds.end());
  if (seeds.size() > kSeeds) seeds.resize(kSeeds);
  std::vector<std::size_t> largest;
  for (const auto& [partners, seed] : seeds) {
    if (static_cast<std::size_t>(1 - partners) <= largest.size()) break;
    std::vector<std::size_t> clique = clique_around(agree, seed);
    if (clique.size() > largest.size()) largest = std::move(clique);
  }
  return largest;
}

struct Consistent {
  std::vector<std::size_t> loops;  ///< positions in what was given
  Pose motion = Pose::Identity();  ///< of the far chain, by the loop nearest to all others
};

Consistent consistent(const PoseGraph& graph, const TrustedForest& forest,
                      std::span<const std::size_t> loops, double scale) {
  Consistent found;
  std::vector<std::size_t> looked_at;
  const std::size_t step = loops.size() / kMostLoops + 1;
  for (std::size_t i = 0; i < loops.size(); i += step) looked_at.push_back(i);
  std::vector<Link> links;
  for (const std::size_t i : looked_at) links.push_back(link(forest, graph.constraints[loops[i]]));
  const std::vector<std::size_t> clique = largest_clique(agreement(forest, links, scale));
  double least = 0;
  for (const std::size_t i : clique) {
    double sum = 0;
    for (const std::size_t k : clique) sum += disagreement(forest, links[i], links[k]);
    if (found.loops.empty() || sum < least) found.motion = links[i].motion, least = sum;
    found.loops.push_back(looked_at[i]);
  }
  return found;
}

struct Bridge {
  std::size_t near, far;  ///< roots of chains, near < far
  Consistent set;
};

/// Between every two chains that loops tie, those with most consistent loops first.
std::vector<Bridge> bridges(const PoseGraph& graph, const TrustedForest& forest, double scale) {
  std::map<std::pair<std::size_t, std::size_t>, std::vector<std::size_t>> loops_between;
  for (std::size_t i = 0; i < graph.constraints.size(); ++i) {
    const Constraint& c = graph.constraints[i];
    const std::size_t a = forest.root(forest.position(c.from));
    const std::size_t b = forest.root(forest.position(c.to));
    if (a != b) loops_between[std::minmax(a, b)].push_back(i);
  }
  std::vector<Bridge> found;
  for (const auto& [roots, loops] : loops_between) {
    found.push_back({roots.first, roots.second, consistent(graph, forest, loops, scale)});
  }
  std::stable_sort(found.begin(), found.end(), [](const Bridge& a, const Bridge& b) {
    return a.set.loops.size() > b.set.loops.size();
  });
  return found;
}

}  // namespace

bool has_chains(const PoseGraph& graph) {
  std::map<CellId, std::size_t> position;
  for (const auto& [id, T] : graph.nodes)
    position.emplace_hint(position.end(), id, position.size());
  Components chains(graph.nodes.size());
  for (const Constraint& c : graph.constraints) {
    if (is_trusted(c)) chains.join(position.at(c.from), position.at(c.to));
  }
  return std::any_of(graph.constraints.begin(), graph.constraints.end(), [&](const Constraint& c) {
    return chains.lowest(position.at(c.from)) != chains.lowest(position.at(c.to));
  });
}

std::vector<std::size_t> consistent_loops(const PoseGraph& graph,
                                          std::span<const std::size_t> loops, double scale) {
  return consistent(graph, TrustedForest(graph), loops, scale).loops;
}

std::map<CellId, Pose> chain_start(const PoseGraph& graph, std::size_t least_loops, double scale) {
  const TrustedForest forest(graph);
  // A tree over the chains, of the bridges with most loops. The motion of a chain is known once
  // its neighbour's is; only those that hang on one another move.
  std::vector<Bridge> tree;
  Components joined(forest.size());
  for (Bridge& bridge : bridges(graph, forest, scale)) {
    if (bridge.set.loops.size() < least_loops || !joined.join(bridge.near, bridge.far)) continue;
    tree.push_back(std::move(bridge));
  }
  std::vector<Pose> motion(forest.size(), Pose::Identity());
  std::vector<bool> is_placed(forest.size());
  for (std::size_t i = 0; i < forest.size(); ++i) is_placed[i] = joined.lowest(i) == i;
  for (bool changed = true; changed;) {
    changed = false;
    for (const Bridge& bridge : tree) {
      if (is_placed[bridge.near] == is_placed[bridge.far]) continue;
      changed = true;
      const bool forwards = is_placed[bridge.near];
      const std::size_t known = forwards ? bridge.near : bridge.far;
      const std::size_t moved = forwards ? bridge.far : bridge.near;
      motion[moved] = motion[known] * (forwards ? bridge.set.motion : bridge.set.motion.inverse());
      is_placed[moved] = true;
    }
  }
  std::map<CellId, Pose> poses = graph.nodes;
  for (auto& [id, T] : poses) T = motion[forest.root(forest.position(id))] * T;
  return poses;
}

}  // namespace cellmap
