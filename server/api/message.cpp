#include "server/api/message.hpp"

#include <algorithm>

#include "server/api/text.hpp"

namespace cellmap::server {

void Headers::set(std::string_view name, std::string value) {
  std::erase_if(fields_, [&](const auto& field) { return equal_no_case(field.first, name); });
  add(name, std::move(value));
}

void Headers::add(std::string_view name, std::string value) {
  if (fields_.empty()) fields_.reserve(16);  // of nearly all messages
  fields_.emplace_back(std::string(name), std::move(value));
}

std::optional<std::string> Headers::get(std::string_view name) const {
  std::optional<std::string> joined;
  for (const auto& [field, value] : fields_) {
    if (!equal_no_case(field, name)) continue;
    if (joined) {
      joined->append(", ").append(value);
    } else {
      joined = value;
    }
  }
  return joined;
}

std::string_view body_view(const Response& response) {
  if (const auto* text = std::get_if<std::string>(&response.body)) return *text;
  if (const auto* shared = std::get_if<SharedBytes>(&response.body)) {
    return {reinterpret_cast<const char*>(shared->bytes->data()) + shared->offset, shared->length};
  }
  return {};
}

}  // namespace cellmap::server
