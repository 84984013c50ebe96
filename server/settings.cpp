#include "server/settings.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ostream>

#include "cellmap/core/error.hpp"
#include "cellmap/store/store_place.hpp"
#include "server/api/text.hpp"
#include "server/http/client_address.hpp"
#include "server/http/listener.hpp"

namespace cellmap::server {
namespace {

constexpr int kUsageError = 2;

constexpr char kFooter[] =
    R"(Example: cellmapd --store maps.db --listen 127.0.0.1:8080 --data-root ~/drives

Every option may also stand in the environment (--log-level: CELLMAPD_LOG_LEVEL) or in the file of --config
(log-level = "debug"). The command line goes before the environment, the environment before the file.
--print-config says what is in force, as such a file.

SIGTERM and SIGINT stop the server; running jobs go on at the next start, or at once in another server of
the same database. SIGHUP makes it read its tokens
again and begin a new audit log where the old one was moved away.)";

std::string environment_name(std::string option) {
  for (char& c : option) c = c == '-' ? '_' : static_cast<char>(std::toupper(c));
  return "CELLMAPD_" + option;
}

/// CLI11 reads the file before it looks at the environment: what stands there is left out.
class FileBelowEnvironment : public CLI::ConfigTOML {
 public:
  explicit FileBelowEnvironment(const CLI::App& app) : app_(app) {}

  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override {
    auto items = CLI::ConfigTOML::from_config(input);
    std::erase_if(items, [&](const CLI::ConfigItem& item) {
      const auto* option = app_.get_option_no_throw("--" + item.name);
      if (!option || option->get_envname().empty()) return false;
      const char* value = std::getenv(option->get_envname().c_str());
      return value && *value;
    });
    return items;
  }

 private:
  const CLI::App& app_;
};

/// The options that stand in files and in the environment too.
void add_options(CLI::App& app, Settings& settings) {
  app.option_defaults()->always_capture_default();
  app.add_option(
      "--store", settings.store,
      "The store: a file, made where it is missing, or postgresql://[user@]host/database");
  app.add_option("--blobs", settings.blobs,
                 "An S3-compatible object store for the bytes of the database's CELLs: "
                 "s3://BUCKET[/PREFIX]; keys: AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY in the "
                 "environment. Default: the database keeps them");
  app.add_option("--blobs-endpoint", settings.blobs_endpoint,
                 "Where it is: http[s]://HOST[:PORT]; default: Amazon's of the region");
  app.add_option("--blobs-region", settings.blobs_region,
                 "The region that requests are signed for");
  app.add_option("--role", settings.role,
                 "Of the servers of one database: api takes jobs and leaves them to others, worker "
                 "only carries them out, all does both")
      ->check(CLI::IsMember({"all", "api", "worker"}));
  app.add_option("--job-lease", settings.job_lease_s,
                 "Seconds after which a server that gives no sign of life loses its jobs to "
                 "others; it gives one three times as often")
      ->check(CLI::Range(0.3, 3600.0));
  app.add_option("--listen", settings.listen,
                 "HOST:PORT (port 0: any free one) or unix:PATH (repeatable, or with commas)")
      ->delimiter(',');
  app.add_option("--data-root", settings.data_roots,
                 "A folder that ingest jobs may read data sets from (repeatable)")
      ->delimiter(',');
  app.add_option("--viewer", settings.viewer,
                 "Folder of the built viewer, served at /; default: the installed one, or the "
                 "build tree's");
  app.add_option(
      "--tokens", settings.tokens,
      "Who may do what: the file of 'cellmap token create'; default: everyone everything");
  app.add_option("--audit", settings.audit, "A file that is told of every write, in JSON lines");
  app.add_option("--rate-limit", settings.rate_limit,
                 "Requests a second of one token, or without tokens of one address; 0: no limit")
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--allow-origin", settings.allow_origins,
                 "A web page that may call from a browser: its origin, or * (repeatable)")
      ->delimiter(',');
  app.add_option("--trusted-proxy", settings.trusted_proxies,
                 "The address of a proxy whose X-Forwarded-For is believed, or unix (repeatable)")
      ->delimiter(',')
      ->check([](const std::string& text) {
        return text == "unix" || address_name(text) ? "" : text + " is no IP address";
      });
  app.add_option("--threads", settings.threads, "Threads of one computation; 0: all")
      ->check(CLI::Range(0, 1024));
  app.add_option("--place-memory", settings.place_memory_mib,
                 "MiB for what relocalisation knows of CELLs, 1.2 kB each; what was used longest "
                 "ago makes room and is read again from the store when it is needed")
      ->check(CLI::Range(1, 1'000'000));
  app.add_option("--place-servers", settings.place_servers,
                 "URLs of the servers of one database, itself too and everywhere the same: each "
                 "keeps what relocalisation knows of its share of every map, and asks the others "
                 "for theirs (http://HOST:PORT; repeatable, or with commas)")
      ->delimiter(',');
  app.add_option("--place-self", settings.place_self, "Which of them this server is");
  app.add_option("--place-timeout", settings.place_timeout_s,
                 "Seconds that another has to answer; then its share is searched here too")
      ->check(CLI::Range(0.05, 600.0));
  app.add_option("--place-alone", settings.place_alone,
                 "As many CELLs, or fewer, are searched by the server that is asked; more by all")
      ->check(CLI::Range(0, 1'000'000'000));
  app.add_option("--max-connections", settings.max_connections,
                 "Held open; beyond them the longest idle one makes room")
      ->check(CLI::Range(16, 1'000'000));
  app.add_option("--log-level", settings.log_level, "How much goes to standard error")
      ->check(CLI::IsMember({"trace", "debug", "info", "warn", "error", "off"}));
  app.add_option("--log-format", settings.log_format, "For people, or an object a line")
      ->check(CLI::IsMember({"text", "json"}));
  app.add_flag("--insecure", settings.insecure,
               "Listen beyond this machine although nobody is asked who they are");
  for (CLI::Option* option : app.get_options()) {
    const auto name = option->get_single_name();
    if (option->get_configurable() && name != "help") option->envname(environment_name(name));
  }
}

/// CLI11 prints lists that nobody set in a form that it does not read.
std::string text_of(CLI::App& app, const Settings& settings) {
  const std::vector<std::pair<const char*, const std::vector<std::string>*>> lists{
      {"--listen", &settings.listen},
      {"--data-root", &settings.data_roots},
      {"--allow-origin", &settings.allow_origins},
      {"--trusted-proxy", &settings.trusted_proxies},
      {"--place-servers", &settings.place_servers}};
  for (const auto& [name, values] : lists) {
    CLI::Option* option = app.get_option(name);
    option->configurable(!values->empty());
    if (option->count() == 0) option->add_result(*values);
  }
  return app.config_to_str(true, true);
}

/// What was wrong, in words of ours.
std::string reason_of(const CLI::ParseError& error) {
  std::string reason = error.what();
  constexpr std::string_view kUnknown = "INI was not able to parse ";
  if (reason.starts_with(kUnknown)) {
    reason =
        "the file of --config has a setting that there is not: " + reason.substr(kUnknown.size());
  }
  return reason + " (cellmapd --help)";
}

int fail(std::ostream& err, const std::string& why) {
  err << "cellmapd: " << why << '\n';
  return kUsageError;
}

}  // namespace

std::variant<Settings, int> read_settings(const std::vector<std::string>& arguments,
                                          std::ostream& out, std::ostream& err) {
  CLI::App app("Serves the maps of one store over HTTP.", "cellmapd");
  Settings settings;
  bool print = false;
  app.footer(kFooter);
  add_options(app, settings);
  app.set_version_flag("--version", "cellmapd " CELLMAP_VERSION);
  const char* file = std::getenv("CELLMAPD_CONFIG");
  app.set_config("--config", file ? file : "", "A file of settings (default: CELLMAPD_CONFIG)",
                 file != nullptr)
      ->configurable(false);
  app.add_flag("--print-config", print, "Print what is in force and stop")->configurable(false);
  app.config_formatter(std::make_shared<FileBelowEnvironment>(app));
  app.allow_config_extras(false);
  try {
    app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error, out, err);
    return fail(err, reason_of(error));
  }
  if (print) {
    out << text_of(app, settings);
    return 0;
  }
  if (settings.store.empty()) {
    return fail(err,
                "--store is required: a file, made where it is missing, or "
                "postgresql://[user@]host/database");
  }
  return settings;
}

std::optional<ObjectStoreOptions> objects_of(const Settings& settings) {
  if (settings.blobs.empty()) return std::nullopt;
  if (store_file(settings.store)) {
    throw Error(ErrorCode::kInvalidArgument,
                "--blobs is for a PostgreSQL database (--store postgresql://...); a file keeps the "
                "bytes of its CELLs itself: leave --blobs out.");
  }
  ObjectStoreOptions objects;
  objects.place = settings.blobs;
  objects.endpoint = settings.blobs_endpoint;
  objects.region = settings.blobs_region;
  objects.take_keys_from_environment();
  objects.validate();
  return objects;
}

namespace {

/// "http://HOST[:PORT]" without a slash at its end: everywhere the same text for the same server.
std::string url_of_server(std::string text) {
  while (text.ends_with('/')) text.pop_back();
  const auto scheme = text.starts_with("https://") ? 8u : 7u;
  const bool good = (text.starts_with("http://") || scheme == 8) && text.size() > scheme &&
                    text.find_first_of("/?#@ \\", scheme) == std::string::npos;
  if (good) return text;
  throw Error(ErrorCode::kInvalidArgument,
              "--place-servers and --place-self take servers as http://10.0.0.1:8080, found " +
                  in_quotes(text) + ".");
}

}  // namespace

PlaceServersOptions place_servers_of(const Settings& settings) {
  const auto refuse = [](const std::string& why) { throw Error(ErrorCode::kInvalidArgument, why); };
  PlaceServersOptions options;
  options.timeout = std::chrono::milliseconds(std::lround(settings.place_timeout_s * 1000));
  options.alone = settings.place_alone;
  for (const std::string& server : settings.place_servers) {
    options.servers.push_back(url_of_server(server));
    if (std::ranges::count(options.servers, options.servers.back()) > 1) {
      refuse("--place-servers has " + options.servers.back() + " twice.");
    }
  }
  if (options.servers.empty() && settings.place_self.empty()) return options;
  if (options.servers.empty()) refuse("--place-self is one of --place-servers, which are missing.");
  if (settings.place_self.empty()) {
    refuse("--place-servers needs --place-self: which of them this server is.");
  }
  options.self = url_of_server(settings.place_self);
  if (std::ranges::count(options.servers, options.self) == 0) {
    refuse("--place-self " + options.self +
           " is none of --place-servers; each server has the same list, and is in it.");
  }
  if (store_file(settings.store)) {
    refuse(
        "--place-servers is for the servers of a PostgreSQL database (--store "
        "postgresql://...); a file has one server: leave it out.");
  }
  if (settings.role == "worker") {
    refuse(
        "--place-servers is for servers that answer; one with --role worker answers nothing: "
        "leave it out, and this server out of the lists of the others.");
  }
  return options;
}

void check_role(const Settings& settings) {
  if (settings.role == "all" || !store_file(settings.store)) return;
  throw Error(ErrorCode::kInvalidArgument,
              "--role " + settings.role +
                  " is for one of several servers of a PostgreSQL database (--store "
                  "postgresql://...); a file has one server, which does everything: leave --role "
                  "out.");
}

void check_addresses(const Settings& settings) {
  if (settings.insecure || !settings.tokens.empty()) return;
  for (const std::string& address : settings.listen) {
    if (is_local(address)) continue;
    throw Error(ErrorCode::kInvalidArgument,
                address +
                    " is no loopback address, and this server would ask nobody who they are. "
                    "Make a token (cellmap token create NAME --tokens FILE --scope map:read) and "
                    "say --tokens FILE; or listen on 127.0.0.1 behind a proxy; or, where everyone "
                    "who reaches it may do everything, say --insecure.");
  }
}

}  // namespace cellmap::server
