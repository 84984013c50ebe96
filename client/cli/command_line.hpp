#pragma once

#include <functional>
#include <iosfwd>
#include <span>
#include <string>
#include <vector>

#include "client/cli/console.hpp"

namespace CLI {
class App;
}

namespace cellmap::cli {

/// The verbs of `cellmap`, each declared by one `add_*` function of the files beside this one.
class Verbs {
 public:
  /// Declares a verb under `parent`: its options bind to what `run` captured. `examples` end its
  /// help. Every verb has --json and --progress.
  CLI::App* add(CLI::App& parent, const std::string& name, const std::string& description,
                const std::string& examples, std::function<void(const Console&)> run);

  /// Runs the verb that the parser met.
  void run(Console console) const;

 private:
  std::function<void(const Console&)> chosen_;
  bool json_ = false;
  bool progress_ = false;
  friend bool json_asked(const Verbs& verbs);
};

/// True where --json was given.
bool json_asked(const Verbs& verbs);

void add_simulate(CLI::App& app, Verbs& verbs);
void add_build(CLI::App& app, Verbs& verbs);
void add_import(CLI::App& app, Verbs& verbs);
void add_serve(CLI::App& app, Verbs& verbs);
void add_token(CLI::App& app, Verbs& verbs);  // token create, list, revoke
void add_ingest(CLI::App& app, Verbs& verbs);
void add_maps(CLI::App& app, Verbs& verbs);  // maps, info, cells
void add_fetch(CLI::App& app, Verbs& verbs);
void add_pull(CLI::App& app, Verbs& verbs);
void add_loops(CLI::App& app, Verbs& verbs);
void add_sessions(CLI::App& app, Verbs& verbs);
void add_merge(CLI::App& app, Verbs& verbs);  // merge, split
void add_jobs(CLI::App& app, Verbs& verbs);
void add_relocalise(CLI::App& app, Verbs& verbs);
void add_evaluate(CLI::App& app, Verbs& verbs);
void add_archive(CLI::App& app, Verbs& verbs);  // archive, restore
void add_verify(CLI::App& app, Verbs& verbs);   // verify, repair
void add_export(CLI::App& app, Verbs& verbs);
void add_optimize(CLI::App& app, Verbs& verbs);

/// Parses and runs one command line (without the program's name) and returns the exit code.
/// `terminal`: the error stream is one. Errors become one line on `err`, and with --json also
/// {"error": {"code", "message"}} on `out`.
int run_command_line(const std::vector<std::string>& arguments, std::ostream& out,
                     std::ostream& err, bool terminal = false);

}  // namespace cellmap::cli
