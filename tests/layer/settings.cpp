// Reading CLOAM_LAYER.
#include "tests/layer/settings.h"

#include <cstdio>
#include <cstdlib>
#include <sstream>

namespace cloam::layer {
namespace {

int64_t number(const std::string& word, const std::string& setting) {
  char* end = nullptr;
  const int64_t value = std::strtoll(word.c_str(), &end, 10);
  if (word.empty() || *end) refuse("\"" + setting + "\": \"" + word + "\" is no number");
  return value;
}

/// FUNCTION:N, FUNCTION:N+ or FUNCTION:N/M, and a CODE after each.
CallAt parse_call(const std::string& value, const std::string& setting) {
  std::istringstream parts(value);
  CallAt out;
  std::string call, code;
  std::getline(parts, out.function, ':');
  std::getline(parts, call, ':');
  if (std::getline(parts, code)) out.code = static_cast<cl_int>(number(code, setting));
  if (call.ends_with('+')) {
    out.every = 1;
    call.pop_back();
  } else if (const size_t slash = call.find('/'); slash != std::string::npos) {
    out.every = number(call.substr(slash + 1), setting);
    call.resize(slash);
  }
  out.call = number(call, setting);
  if (out.call < 1) refuse("\"" + setting + "\": calls are counted from 1");
  return out;
}

void parse_setting(const std::string& setting, Settings& out) {
  const size_t equal = setting.find('=');
  const std::string name = setting.substr(0, equal);
  const std::string value = equal == std::string::npos ? "" : setting.substr(equal + 1);
  if (setting == "sticky")
    out.sticky = true;
  else if (name == "count" && !value.empty())
    out.count_file = value;
  else if (name == "profile" && !value.empty())
    out.profile = value;
  else if (name == "group")
    out.group = number(value, setting);
  else if (name == "memory")
    out.memory = number(value, setting);
  else if (name == "version" && !value.empty())
    out.version = value;
  else if (name == "fail")
    out.failures.push_back(parse_call(value, setting));
  else if (name == "hang")
    out.hangs.push_back(parse_call(value, setting));
  else
    refuse(
        "\"" + setting +
        "\" is no setting; there are count=FILE, fail=FUNCTION:N[+|/M][:CODE], sticky, hang=FUNCTION:N, profile=NAME, "
        "group=N, memory=N, version=N");
}

Settings parse() {
  Settings out;
  const char* given = std::getenv("CLOAM_LAYER");
  std::istringstream words(given ? given : "");
  for (std::string word; std::getline(words, word, ',');)
    if (!word.empty()) parse_setting(word, out);
  return out;
}

}  // namespace

const Settings& settings() {
  static const auto* const parsed = new Settings(parse());  // never destroyed: calls come until the process ends
  return *parsed;
}

void refuse(const std::string& why) {
  std::fprintf(stderr, "cloam layer: CLOAM_LAYER: %s\n", why.c_str());
  std::_Exit(2);
}

}  // namespace cloam::layer
