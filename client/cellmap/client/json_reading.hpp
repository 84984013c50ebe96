#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cellmap/client/json.hpp"

// What the sources of json.hpp read documents with.

namespace cellmap::client {

/// Runs a decoder and turns the JSON library's complaints (missing key, wrong type) into ours.
template <typename Decode>
decltype(auto) decoded(const char* what, Decode decode) {
  try {
    return decode();
  } catch (const Json::exception& error) {
    throw Error(ErrorCode::kCorruptData, std::string("the server's ") + what +
                                             " is not as the API describes it (" + error.what() +
                                             "); do client and server have the same version?");
  } catch (const Error& error) {
    if (error.code() == ErrorCode::kCorruptData) throw;
    throw Error(ErrorCode::kCorruptData, std::string("the server's ") + what +
                                             " holds a value out of range: " + error.what());
  }
}

template <typename Integer>
Integer integer(const Json& json) {
  if (!json.is_number_unsigned() ||
      json.get<std::uint64_t>() > static_cast<std::uint64_t>(std::numeric_limits<Integer>::max())) {
    throw Error(ErrorCode::kCorruptData, "a non-negative integer of " +
                                             std::to_string(8 * sizeof(Integer)) +
                                             " bits was expected, found " + dump(json, false));
  }
  return static_cast<Integer>(json.get<std::uint64_t>());
}

inline std::uint64_t count(const Json& json, const char* key) {
  return integer<std::uint64_t>(json.at(key));
}

template <typename Id>
Id id(const Json& json) {
  return Id{integer<std::uint32_t>(json)};
}

/// A number that may be left out or null.
inline double number_or(const Json& json, const char* key, double otherwise) {
  const auto found = json.find(key);
  return found == json.end() || found->is_null() ? otherwise : found->get<double>();
}

template <std::size_t N>
std::array<double, N> numbers(const Json& json) {
  if (!json.is_array() || json.size() != N) {
    throw Error(ErrorCode::kCorruptData, "an array of " + std::to_string(N) +
                                             " numbers was expected, found " + dump(json, false));
  }
  std::array<double, N> values;
  for (std::size_t i = 0; i < N; ++i) values[i] = json[i].get<double>();
  return values;
}

template <typename T, typename Decode>
std::vector<T> list_of(const Json& json, Decode decode) {
  std::vector<T> list;
  for (const Json& item : json) list.push_back(decode(item));
  return list;
}

}  // namespace cellmap::client
