#include "cellmap/client/coded_cells.hpp"

#include <cstdio>
#include <cstdlib>

#include "cellmap/client/client_impl.hpp"
#include "cellmap/codec/cell_batch.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

using client::as_bytes;
using client::HttpRequest;
using client::HttpResponse;
using client::Json;

constexpr std::size_t kCodedBatchCells = 128;

std::string media_type(const char* type, const CodedCellForm& form, bool is_coarse) {
  std::string text = std::string("application/vnd.cellmap.") + type;
  if (form.encoding == CellEncoding::kPacked) {
    text += ";encoding=packed";
  } else {
    char bound[32];
    std::snprintf(bound, sizeof(bound), "%.6g", form.bound_m);
    text += std::string(";encoding=compact;bound=") + bound;
  }
  return is_coarse ? text + ";layers=coarse" : text;
}

/// Throws unless it is as exact as was asked for: who asks for 20 mm must not be given 50.
void check_form(const DecodedCell& decoded, const CodedCellForm& form) {
  const double asked_m = form.encoding == CellEncoding::kCompact ? form.bound_m : 0;
  if (decoded.bound_m <= asked_m + 1e-9) return;
  const std::string kept = to_string(compact_form(decoded.bound_m));
  throw Error(ErrorCode::kConflict, "the server has the CELL as '" + kept +
                                        "' only, less exact than what was asked for; ask for " +
                                        "that bound or a wider one");
}

/// A CELL of the list, coded on its way; or one that the map keeps coded, which the list names by
/// what it decodes to.
bool is_of(const CellRecord& record, const DecodedCell& decoded) {
  return decoded.raw_hash == record.hash || encode_cell(decoded.cell).hash == record.hash;
}

}  // namespace

CodedCellForm coded_form_of(const CellForm& form) {
  if (form.encoding == KeptEncoding::kRaw) {
    throw Error(ErrorCode::kInvalidArgument, "a coded CELL is packed or compact, not raw");
  }
  return {form.is_exact() ? CellEncoding::kPacked : CellEncoding::kCompact, form.bound_m()};
}

struct CodedCellReader::Impl {
  explicit Impl(const ClientOptions& options) : transport(options) {}

  HttpResponse get(const std::string& map, CellId id, const CodedCellForm& form, bool is_coarse) {
    HttpRequest request{
        "GET", client::map_path(map) + "/cells/" + std::to_string(id.value), {}, ""};
    request.headers["accept"] = media_type("coded-cell", form, is_coarse);
    request.max_answer_bytes = kMaxCodedCellBytes;
    return transport.perform(request);
  }

  FetchedCodedCell whole(CellId id, std::span<const std::byte> bytes, const CodedCellForm& form) {
    FetchedCodedCell fetched{id, {bytes.begin(), bytes.end()}, decoder.decode(bytes), bytes.size()};
    check_form(fetched.decoded, form);
    return fetched;
  }

  client::Transport transport;
  CellDecoder decoder;
};

CodedCellReader::CodedCellReader(const ClientOptions& options) {
  options.validate();
  impl_ = std::make_unique<Impl>(options);
}
CodedCellReader::~CodedCellReader() = default;
CodedCellReader::CodedCellReader(CodedCellReader&&) noexcept = default;
CodedCellReader& CodedCellReader::operator=(CodedCellReader&&) noexcept = default;

Traffic CodedCellReader::traffic() const { return impl_->transport.traffic(); }

FetchedCodedCell CodedCellReader::cell(const std::string& map, CellId id,
                                       const CodedCellForm& form) {
  return impl_->whole(id, as_bytes(impl_->get(map, id, form, false).body), form);
}

FetchedCodedCell CodedCellReader::coarse_cell(const std::string& map, CellId id,
                                              const CodedCellForm& form) {
  const HttpResponse response = impl_->get(map, id, form, true);
  const auto bytes = as_bytes(response.body);
  const auto file_bytes = std::strtoull(response.header("cellmap-file-bytes").c_str(), nullptr, 10);
  FetchedCodedCell fetched{
      id, {bytes.begin(), bytes.end()}, decode_coarse_cell(bytes, file_bytes), file_bytes};
  check_form(fetched.decoded, form);
  return fetched;
}

void CodedCellReader::for_each_cell(
    const std::string& map, std::span<const CellRecord> cells, const CodedCellForm& form,
    const std::function<void(const CellRecord&, const FetchedCodedCell&)>& on_cell) {
  std::map<CellId, const CellRecord*> missing;
  for (const CellRecord& cell : cells) missing[cell.id] = &cell;
  while (!missing.empty()) {
    Json ids = Json::array();
    for (auto cell = missing.begin(); cell != missing.end() && ids.size() < kCodedBatchCells;
         ++cell) {
      ids.push_back(cell->first.value);
    }
    HttpRequest request = client::json_request("POST", client::map_path(map) + "/cells:batch",
                                               {{"ids", std::move(ids)}});
    request.headers["accept"] = media_type("coded-cells", form, false);
    request.max_answer_bytes = kMaxBatchBytes;
    const HttpResponse response = impl_->transport.perform(request);
    CellBatchReader reader(as_bytes(response.body));
    bool is_any = false;
    while (const auto entry = reader.next()) {
      const auto found = missing.find(entry->id);
      if (found == missing.end()) continue;
      const FetchedCodedCell fetched = impl_->whole(entry->id, entry->bytes, form);
      if (!is_of(*found->second, fetched.decoded)) {
        throw Error(ErrorCode::kConflict, "CELL " + std::to_string(entry->id.value) + " of map '" +
                                              map +
                                              "' is another one than the list says; "
                                              "start again");
      }
      on_cell(*found->second, fetched);
      missing.erase(found);
      is_any = true;
    }
    if (!is_any) {
      throw Error(ErrorCode::kConflict, "the server sent none of the CELLs that were asked for");
    }
  }
}

}  // namespace cellmap
