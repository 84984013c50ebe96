#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/store/parts.hpp"
#include "store/claims_contract.hpp"

namespace cellmap::test {

inline Bytes some_bytes(std::size_t size) {
  Bytes bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::byte>(i * i >> 3);
  return bytes;
}

/// What every engine must do for workers that help each other; an engine joins as above.
class PartsContract : public ClaimsContract {
 protected:
  Parts& parts() { return parts_of(*store_); }

  /// The n-th part of a job: four CELLs of ten scans.
  static JobPart part(const HeldJob& job, std::uint32_t n) {
    return {claim_of(job), 4 * n, 40 * std::uint64_t{n}, 40};
  }
  HeldJob holder_with_parts(std::uint32_t count) {
    queue("town");
    const HeldJob job = *claim("holder");
    offer(job, count);
    return job;
  }
  void offer(const HeldJob& job, std::uint32_t count) {
    std::vector<JobPart> offers;
    for (std::uint32_t n = 0; n < count; ++n) offers.push_back(part(job, n));
    parts().offer_parts(offers);
  }
  std::optional<std::uint32_t> taken(const HeldJob& job, const std::string& worker) {
    const auto part = parts().take_part(job.record.id, worker);
    return part ? std::optional(part->first_sequence) : std::nullopt;
  }
};

}  // namespace cellmap::test
