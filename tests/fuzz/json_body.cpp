// A JSON body, and what is read out of one: ingest jobs, lattices, poses, forms, sessions.
#include "fuzz/fuzz.hpp"
#include "server/jobs/ingest_request.hpp"

FUZZ_TARGET(bytes) {
  using namespace cellmap::server;
  const Json json = parse_json(cellmap::fuzz::text_of(bytes));
  dump(json);
  const auto tried = [](const auto& read) { cellmap::fuzz::accept_or_refuse(read); };
  tried([&] { parse_ingest_request(json); });
  tried([&] { lattice_from_json(json); });
  tried([&] { session_names(json); });
  tried([&] {
    ObjectReader reader(json, "body");
    tried([&] { reader.pose("pose"); });
    tried([&] { reader.matrix("matrix"); });
    tried([&] { reader.numbers("pose", 7); });
    tried([&] { reader.number("number"); });
    tried([&] { reader.integer("number", 100); });
    tried([&] { reader.text("text"); });
    tried([&] { read_form(reader); });
    reader.finish();
  });
}
