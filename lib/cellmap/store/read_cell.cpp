#include "cellmap/store/read_cell.hpp"

#include "cellmap/codec/zstd.hpp"

namespace cellmap {

KeptCell open_stored_cell(const StoredCell& stored) {
  return open_kept_cell(zstd_decompress(*stored.frame, kMaxCellBytes), stored.hash);
}

KeptCell read_kept_cell(const Store& store, const std::string& map, CellId id) {
  return open_stored_cell(store.stored_cell(map, id));
}

Cell read_cell(const Store& store, const std::string& map, CellId id) {
  return cell_of(store.stored_cell(map, id));
}

Cell cell_of(const StoredCell& stored) {
  if (stored.form.encoding == KeptEncoding::kRaw) return decode_stored_cell(*stored.frame);
  return *open_stored_cell(stored).cell;
}

EncodedCell read_encoded_cell(const Store& store, const std::string& map, CellId id) {
  return encoded_of(store.stored_cell(map, id));
}

EncodedCell encoded_of(const StoredCell& stored) {
  if (stored.form.encoding == KeptEncoding::kRaw) {
    return {stored.hash, zstd_decompress(*stored.frame, kMaxCellBytes)};
  }
  return open_stored_cell(stored).encoded;
}

}  // namespace cellmap
