// What reading JSON promises beside its values: time that grows with the length.
#include "models/io/json.h"

#include <doctest/doctest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "tests/models/errors.h"
#include "tests/models/folder.h"

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

TEST_CASE("values of a list in a file come one at a time, as they are when all are read at once") {
  const Folder folder;
  const auto file = folder.path / "rows.json";
  const auto values_of = [&](const std::string& content) {
    write_text(file, content);
    std::vector<Json> all;
    for_each_in_json_file(file, [&](const Json& value, std::size_t number) {
      CHECK(number == all.size());
      all.push_back(value);
    });
    return all;
  };
  const std::string rows = R"([{"a":[[1,2],{"b":[]}]}, 7, "x", [], null, {"a":{"a":1}}])";
  CHECK(Json(values_of(rows)) == parse_json(rows, "rows"));
  CHECK(values_of("[]").empty());
  for (const auto& [content, said] :
       {std::pair{R"({"a":[1]})", "want a list, found object"}, std::pair{"7", "want a list, found number"},
        std::pair{R"([{"a":1,"a":2}])", "the key \"a\" appears twice"}, std::pair{R"([{"a":1})", "not valid JSON"},
        std::pair{"", "not valid JSON"}})
    CHECK_MESSAGE(holds(error_of([&, text = std::string(content)] { values_of(text); }), said), content);
}
