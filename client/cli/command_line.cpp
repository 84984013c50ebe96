#include "client/cli/command_line.hpp"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <new>
#include <nlohmann/json.hpp>
#include <ostream>

#include "cellmap/core/error.hpp"
#include "client/cli/compare.hpp"
#include "client/cli/copy.hpp"
#include "client/cli/diff.hpp"
#include "client/cli/exit_code.hpp"
#include "client/cli/store_care.hpp"

namespace cellmap::cli {
namespace {

constexpr char kDescription[] =
    "CELLmap: an elastic, lightweight LiDAR map. Builds maps from drives, serves and fetches them, "
    "finds scans in them.";

constexpr char kExamples[] =
    R"(Examples:
  cellmap simulate --route town --scans 300 --out drive
  cellmap build drive --store map.db --map town
  cellmap serve --store map.db --listen 127.0.0.1:8080
  cellmap relocalise scan.bin --server http://127.0.0.1:8080 --map town

)";

void add_all(CLI::App& app, Verbs& verbs) {
  add_simulate(app, verbs);
  add_build(app, verbs);
  add_import(app, verbs);
  add_serve(app, verbs);
  add_token(app, verbs);
  add_ingest(app, verbs);
  add_maps(app, verbs);
  add_fetch(app, verbs);
  add_pull(app, verbs);
  add_loops(app, verbs);
  add_sessions(app, verbs);
  add_diff(app, verbs);
  add_merge(app, verbs);
  add_jobs(app, verbs);
  add_relocalise(app, verbs);
  add_evaluate(app, verbs);
  add_compare(app, verbs);
  add_archive(app, verbs);
  add_verify(app, verbs);
  add_store_care(app, verbs);
  add_copy(app, verbs);
  add_export(app, verbs);
  add_optimize(app, verbs);
}

int report(const Verbs& verbs, std::ostream& out, std::ostream& err, ErrorCode code,
           const std::string& message) {
  err << "cellmap: " << message << '\n';
  if (json_asked(verbs)) {
    out << client::dump({{"error", {{"code", to_string(code)}, {"message", message}}}}) << '\n';
  }
  return exit_code(code);
}

}  // namespace

CLI::App* Verbs::add(CLI::App& parent, const std::string& name, const std::string& description,
                     const std::string& examples, std::function<void(const Console&)> run) {
  CLI::App* verb = parent.add_subcommand(name, description);
  verb->footer("Examples:\n" + examples);
  verb->add_flag("--json", json_, "Print one JSON document instead of text");
  verb->add_flag("--progress", progress_, "Show progress even where no terminal is attached");
  // The parser calls a parent after its children: `maps create` is not `maps`.
  verb->callback([this, verb, run = std::move(run)] {
    if (verb->get_subcommands().empty()) chosen_ = run;
  });
  return verb;
}

void Verbs::run(Console console) const {
  console.json = json_;
  console.progress = progress_ || console.terminal;
  if (chosen_) chosen_(console);
}

bool json_asked(const Verbs& verbs) { return verbs.json_; }

int run_command_line(const std::vector<std::string>& arguments, std::ostream& out,
                     std::ostream& err, bool terminal) {
  CLI::App app(kDescription, "cellmap");
  Verbs verbs;
  app.set_version_flag("--version", "cellmap " CELLMAP_VERSION);
  app.require_subcommand(1);
  app.footer(kExamples + exit_code_help());
  add_all(app, verbs);
  const bool verb_given = !arguments.empty() && !arguments.front().starts_with('-');
  const auto is_meant = [&](CLI::App* verb) { return verb->get_name() == arguments.front(); };
  if (verb_given && app.get_subcommands(is_meant).empty()) {
    err << "cellmap: there is no verb '" << arguments.front() << "'; see cellmap --help\n";
    return kUsageError;
  }
  try {
    app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::ParseError& error) {
    return app.exit(error, out, err) == 0 ? kSuccess : kUsageError;
  }
  try {
    verbs.run({out, err, false, false, terminal});
    return kSuccess;
  } catch (const Error& error) {
    return report(verbs, out, err, error.code(), error.what());
  } catch (const std::filesystem::filesystem_error& error) {
    return report(verbs, out, err, ErrorCode::kIo, error.what());
  } catch (const std::bad_alloc&) {
    return report(verbs, out, err, ErrorCode::kTooLarge, "out of memory");
  } catch (const std::exception& error) {
    return report(verbs, out, err, ErrorCode::kInternal,
                  std::string("unexpected: ") + error.what());
  }
}

}  // namespace cellmap::cli
