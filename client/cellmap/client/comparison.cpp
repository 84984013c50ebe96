#include "cellmap/client/comparison.hpp"

#include "cellmap/client/client_impl.hpp"

namespace cellmap {
namespace {

std::string path_of(const std::string& map) { return client::map_path(map) + "/comparison"; }

}  // namespace

void put_comparison(const ClientOptions& server, const std::string& map, const std::string& json) {
  client::HttpRequest request{"PUT", path_of(map), {{"content-type", "application/json"}}, json};
  client::Transport(server).perform(request);
}

std::string comparison_text(const ClientOptions& server, const std::string& map) {
  return client::Transport(server).perform({"GET", path_of(map), {}, ""}).body;
}

}  // namespace cellmap
