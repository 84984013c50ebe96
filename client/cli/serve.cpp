#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <system_error>

#include "cellmap/core/error.hpp"
#include "client/cli/command_line.hpp"

namespace cellmap::cli {
namespace fs = std::filesystem;
namespace {

/// Beside this program (installed), or in the server's folder of the same build tree; else the PATH
/// is searched.
std::string find_cellmapd() {
  std::error_code error;
  const fs::path here = fs::read_symlink("/proc/self/exe", error).parent_path();
  for (const fs::path& candidate :
       {here / "cellmapd", here.parent_path() / "server" / "cellmapd"}) {
    if (!error && fs::is_regular_file(candidate)) return candidate.string();
  }
  return "cellmapd";
}

[[noreturn]] void become_server(const std::vector<std::string>& arguments) {
  const std::string program = find_cellmapd();
  std::vector<char*> argv = {const_cast<char*>(program.c_str())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  ::execvp(program.c_str(), argv.data());
  throw Error(ErrorCode::kNotFound, "cannot start cellmapd (" +
                                        std::generic_category().message(errno) +
                                        "): it is neither beside this program nor on the PATH");
}

struct ServeArguments {
  std::string config, store, listen = "127.0.0.1:8080", log_level, threads, tokens, audit;
  std::vector<std::string> data_roots;
  bool insecure = false;
};

std::vector<std::string> server_arguments(const ServeArguments& options) {
  std::vector<std::string> arguments = {"--store", options.store, "--listen", options.listen};
  const auto pass = [&](const char* flag, const std::string& value) {
    if (!value.empty()) arguments.insert(arguments.end(), {flag, value});
  };
  for (const std::string& root : options.data_roots) {
    arguments.insert(arguments.end(), {"--data-root", root});
  }
  pass("--config", options.config);
  pass("--tokens", options.tokens);
  pass("--audit", options.audit);
  pass("--threads", options.threads);
  pass("--log-level", options.log_level);
  if (options.insecure) arguments.push_back("--insecure");
  return arguments;
}

}  // namespace

void add_serve(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<ServeArguments>();
  CLI::App* verb =
      verbs.add(app, "serve", "Start the server (cellmapd) in place of this process",
                "  cellmap serve --store map.db --listen 127.0.0.1:8080\n"
                "  cellmap serve --store map.db --listen 127.0.0.1:0 --data-root /drives\n",
                [options](const Console&) { become_server(server_arguments(*options)); });
  verb->add_option("--store", options->store, "Store file; made where it is missing")->required();
  verb->add_option("--listen", options->listen, "HOST:PORT; port 0: any free one, printed at start")
      ->capture_default_str();
  verb->add_option("--data-root", options->data_roots,
                   "Folder whose drives may be ingested by path (repeatable)");
  verb->add_option("--threads", options->threads, "Worker threads (default: the server's)");
  verb->add_option("--tokens", options->tokens,
                   "Token file ('cellmap token create'): who may do what");
  verb->add_option("--audit", options->audit, "File that is told of every write");
  verb->add_option("--config", options->config, "Configuration of cellmapd (cellmapd --help)");
  verb->add_flag("--insecure", options->insecure,
                 "Listen beyond this machine although nobody is asked who they are");
  verb->add_option("--log-level", options->log_level, "How much it logs (default: the server's)");
}

}  // namespace cellmap::cli
