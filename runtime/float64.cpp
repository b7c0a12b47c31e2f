// Rewrites OpenCL C word by word. It knows numbers and names, which is all that a change of the type needs.
#include "runtime/float64.h"

#include <cctype>
#include <string_view>

namespace cloam {
namespace {

bool in_word(char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; }

/// Also 1.5e-3f and 0x1p-24f, whose signs belong to them.
bool in_number(std::string_view text, size_t at) {
  if (in_word(text[at]) || text[at] == '.') return true;
  const char before = text[at - 1];
  const bool hexadecimal = text.starts_with("0x");
  return (text[at] == '+' || text[at] == '-') && (hexadecimal ? before == 'p' : before == 'e');
}

size_t length_of_number(std::string_view text) {
  size_t end = 1;
  while (end < text.size() && in_number(text, end)) end++;
  return end;
}

size_t length_of_word(std::string_view text) {
  size_t end = 1;
  while (end < text.size() && in_word(text[end])) end++;
  return end;
}

std::string number_in_float64(std::string_view number) {
  const bool integer = number.starts_with("0x") && number.find('p') == std::string_view::npos;
  return std::string(integer || number.back() != 'f' ? number : number.substr(0, number.size() - 1));
}

/// float16 -> double16, convert_float4 -> convert_double4.
std::string word_in_float64(std::string_view word) {
  if (word == "INFINITY") return "HUGE_VAL";
  if (word == "NAN") return "nan(0ul)";
  const size_t at = word.starts_with("convert_") ? 8 : 0;
  if (word.substr(at, 5) != "float") return std::string(word);
  const std::string_view lanes = word.substr(at + 5);
  for (char c : lanes)
    if (!std::isdigit(static_cast<unsigned char>(c))) return std::string(word);
  return std::string(word.substr(0, at)) + "double" + std::string(lanes);
}

}  // namespace

std::string in_float64(const std::string& source) {
  std::string out = "#pragma OPENCL EXTENSION cl_khr_fp64 : enable\n";
  const std::string_view text = source;
  for (size_t at = 0; at < text.size();) {
    const std::string_view rest = text.substr(at);
    const bool digit_follows = rest.size() > 1 && std::isdigit(static_cast<unsigned char>(rest[1]));
    size_t length = 1;
    if (std::isdigit(static_cast<unsigned char>(rest[0])) || (rest[0] == '.' && digit_follows)) {
      length = length_of_number(rest);
      out += number_in_float64(rest.substr(0, length));
    } else if (in_word(rest[0])) {
      length = length_of_word(rest);
      out += word_in_float64(rest.substr(0, length));
    } else {
      out += rest[0];
    }
    at += length;
  }
  return out;
}

}  // namespace cloam
