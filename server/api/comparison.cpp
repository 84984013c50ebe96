#include "server/api/comparison.hpp"

#include <initializer_list>
#include <optional>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/store/documents.hpp"

// The last comparison of representations that `cellmap compare` put: measured elsewhere, kept here
// as it came once it was found to be one.

namespace cellmap::server {
namespace {

constexpr std::size_t kMaxComparisonBody = 1u << 20;
constexpr std::size_t kMaxRows = 500, kMaxTextBytes = 512;
constexpr std::uint64_t kMaxCount = std::uint64_t{1} << 53;
constexpr char kDocument[] = "comparison";

[[noreturn]] void refuse(const std::string& message) {
  throw Error(ErrorCode::kInvalidArgument, message);
}

void check_text(const std::optional<std::string>& text, const char* what) {
  if (text && text->size() > kMaxTextBytes) {
    refuse(std::string("Expected ") + what + " of at most 512 bytes.");
  }
}

/// Takes members out of an object that must be there and be null or a number >= 0.
void take_figures(Json& json, const std::string& name, std::initializer_list<const char*> keys) {
  for (const char* key : keys) {
    const auto found = json.find(key);
    const bool good = found != json.end() &&
                      (found->is_null() || (found->is_number() && found->get<double>() >= 0));
    if (!good) {
      refuse("Expected '" + std::string(key) + "' in " + name + " to be null or at least 0.");
    }
    json.erase(found);
  }
}

/// A copy, because figures are taken out of it until only what is read by name is left.
void check_row(Json json) {
  if (!json.is_object()) refuse("Expected every row to be a JSON object.");
  take_figures(json, "a row",
               {"bytes", "bytes_per_m", "planes", "bytes_per_plane", "accuracy_m", "completeness_m",
                "registration_error_m", "registration_origin_m", "registration_turn_deg",
                "registrations", "registrations_failed", "encode_s", "decode_s"});
  ObjectReader reader(json, "a row");
  const auto name = reader.text("name");
  const auto measured = reader.boolean("measured");
  if (!name || name->empty() || !measured) {
    refuse("Expected 'name' and 'measured' in every row.");
  }
  check_text(name, "a row's name");
  check_text(reader.text("note"), "a row's note");
  const Json* f_score = reader.object("f_score");
  reader.finish();
  if (!f_score) refuse("Expected 'f_score' in every row.");
  Json scores = *f_score;
  take_figures(scores, "an f_score", {"0.05", "0.1", "0.2"});
  ObjectReader(scores, "an f_score").finish();
}

/// Throws Error{kInvalidArgument} for anything but a comparison.
void check_comparison(const Json& json) {
  ObjectReader reader(json, "the comparison");
  const auto dataset = reader.text("dataset");
  const auto length_m = reader.number("length_m");
  const auto scans = reader.integer("scans", kMaxCount);
  const auto held_back = reader.integer("held_back", kMaxCount);
  const Json* rows = reader.array("rows", kMaxRows);
  reader.finish();
  if (!dataset || !length_m || *length_m < 0 || !scans || !held_back || !rows) {
    refuse("Expected 'dataset', 'scans', 'held_back', 'length_m' and 'rows'.");
  }
  check_text(dataset, "a 'dataset'");
  for (const Json& row : *rows) check_row(row);
}

Response get_comparison(Services& services, const Call& call) {
  const auto text = documents_of(services.store).document(call.path("map"), kDocument);
  if (!text) {
    throw Error(ErrorCode::kNotFound,
                "No comparison is kept with this map; put one with 'cellmap compare'.");
  }
  return json_response(Json::parse(*text));
}

Response put_comparison(Services& services, const Call& call) {
  const Json json = call.json();
  check_comparison(json);
  documents_of(services.store).put_document(call.path("map"), kDocument, dump(json));
  return json_response(json);
}

}  // namespace

void add_comparison_routes(Router& router, Services& services) {
  const std::vector<std::string_view> json{"application/json"};
  const std::string path = "/v1/maps/{map}/comparison";
  router.add(
      {"GET", path, {}, 0, json, [&](const Call& call) { return get_comparison(services, call); }});
  router.add({"PUT", path, {}, kMaxComparisonBody, json, [&](const Call& call) {
                return put_comparison(services, call);
              }});
}

}  // namespace cellmap::server
