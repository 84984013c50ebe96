#include "server/api/message.hpp"

#include <algorithm>

#include "server/api/text.hpp"

namespace cellmap::server {

namespace {

constexpr std::string_view kColon = ": ", kEnd = "\r\n", kComma = ", ";
/// Of nearly all messages.
constexpr std::size_t kUsualBytes = 1000, kUsualFields = 16;

}  // namespace

Headers::Field Headers::at(const Place& place) const {
  const char* const begin = text_.data() + place.begin;
  return {{begin, place.name_size}, {begin + place.name_size + kColon.size(), place.value_size}};
}

std::size_t Headers::find(std::string_view name) const {
  std::size_t i = 0;
  while (i < places_.size() &&
         (places_[i].name_size != name.size() || !equal_no_case(at(places_[i]).name, name))) {
    ++i;
  }
  return i;
}

void Headers::append(std::string_view name, std::string_view value) {
  if (places_.empty()) {
    text_.reserve(kUsualBytes);
    places_.reserve(kUsualFields);
  }
  places_.push_back({text_.size(), name.size(), value.size()});
  text_.append(name).append(kColon).append(value).append(kEnd);
}

void Headers::set(std::string_view name, std::string_view value) {
  if (const std::size_t i = find(name); i < places_.size()) {
    const Place old = places_[i];
    const std::size_t size = old.name_size + kColon.size() + old.value_size + kEnd.size();
    text_.erase(old.begin, size);
    places_.erase(places_.begin() + static_cast<std::ptrdiff_t>(i));
    for (Place& place : places_) place.begin -= place.begin > old.begin ? size : 0;
  }
  append(name, value);
}

void Headers::add(std::string_view name, std::string_view value) {
  const std::size_t i = find(name);
  if (i == places_.size()) return append(name, value);
  const std::string joined = std::string(at(places_[i]).value).append(kComma).append(value);
  set(name, joined);
}

std::optional<std::string_view> Headers::get(std::string_view name) const& {
  const std::size_t i = find(name);
  return i < places_.size() ? std::optional(at(places_[i]).value) : std::nullopt;
}

std::vector<Headers::Field> Headers::fields() const {
  std::vector<Field> fields;
  for (const Place& place : places_) fields.push_back(at(place));
  return fields;
}

std::string_view body_view(const Response& response) {
  if (const auto* text = std::get_if<std::string>(&response.body)) return *text;
  if (const auto* shared = std::get_if<SharedBytes>(&response.body)) {
    return {reinterpret_cast<const char*>(shared->bytes->data()) + shared->offset, shared->length};
  }
  return {};
}

}  // namespace cellmap::server
