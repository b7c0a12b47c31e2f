// What reading JSON promises beside its values: time that grows with the length.
#include "models/io/json.h"

#include <doctest/doctest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

using namespace cloam;

namespace {

constexpr rlim_t kLimit = 20;  // seconds of CPU for what takes a fraction of one

/// Whether a child process ends the action by itself, before the system ends it for the time it takes.
template <class Action>
bool ends(const Action& action) {
  const pid_t child = fork();
  if (child == 0) {
    const rlimit limit = {kLimit, kLimit};
    setrlimit(RLIMIT_CPU, &limit);
    action();
    _exit(0);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

}  // namespace

// A parser that looks at all earlier values of a list whenever an object in it ends looks at 8e10 values here: minutes.
TEST_CASE("long lists of objects take time by their length, not by its square") {
  std::string objects = "[{\"a\":NaN}";
  for (int i = 0; i < 400000; ++i) objects += ",{}";
  objects += "]";
  REQUIRE(ends([&] { parse_json(objects, "many"); }));
  const Json json = parse_json(objects, "many");
  CHECK(json.size() == 400001);
  CHECK(json[0].at("a").is_null());
  CHECK(json.back().is_object());
}

TEST_CASE("Python's words for numbers that JSON has not become null, but not in strings") {
  CHECK(
      parse_json(R"({"a":"NaN -Infinity \" NaN","b":[-Infinity,-1.5,true,{"c":18446744073709551615}]})", "x").dump() ==
      R"({"a":"NaN -Infinity \" NaN","b":[null,-1.5,true,{"c":18446744073709551615}]})");
}
