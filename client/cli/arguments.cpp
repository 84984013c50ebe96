#include "client/cli/arguments.hpp"

#include <cmath>
#include <cstdlib>
#include <vector>

#include "cellmap/core/error.hpp"

namespace cellmap::cli {
namespace {

/// All numbers of the text; an empty list where anything else stands in it.
std::vector<double> numbers_in(std::string text) {
  for (char& c : text) {
    if (c == ',') c = ' ';
  }
  std::vector<double> numbers;
  const char* next = text.c_str();
  while (true) {
    while (*next == ' ' || *next == '\t') ++next;
    if (*next == '\0') return numbers;
    char* end = nullptr;
    const double number = std::strtod(next, &end);
    if (end == next || !std::isfinite(number)) return {};
    numbers.push_back(number);
    next = end;
  }
}

}  // namespace

template <std::size_t N>
std::array<double, N> parse_numbers(const std::string& option, const std::string& expected,
                                    const std::string& text) {
  const std::vector<double> found = numbers_in(text);
  if (found.size() != N) {
    throw Error(ErrorCode::kInvalidArgument,
                option + " expects the " + std::to_string(N) + " numbers \"" + expected +
                    "\" in one argument (use quotes), not \"" + text + "\"");
  }
  std::array<double, N> numbers;
  std::copy_n(found.begin(), N, numbers.begin());
  return numbers;
}

template std::array<double, 3> parse_numbers<3>(const std::string&, const std::string&,
                                                const std::string&);
template std::array<double, 6> parse_numbers<6>(const std::string&, const std::string&,
                                                const std::string&);
template std::array<double, 7> parse_numbers<7>(const std::string&, const std::string&,
                                                const std::string&);
template std::array<double, 12> parse_numbers<12>(const std::string&, const std::string&,
                                                  const std::string&);

Pose parse_pose(const std::string& option, const std::string& text) {
  const auto numbers = parse_numbers<7>(option, "x y z qx qy qz qw", text);
  try {
    return pose_from_xyz_qxyzw(numbers);
  } catch (const Error& error) {
    throw Error(ErrorCode::kInvalidArgument, option + ": " + error.what());
  }
}

}  // namespace cellmap::cli
