// Every op row against its float64 reference; every registered op must have a row.
#include "runtime/op.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <set>

#include "tests/op_cases/op_cases.h"

using namespace cloam;

TEST_CASE("every registered op has a row") {
  std::set<std::string> rows;
  for (const OpCase& row : op_cases()) rows.insert(row.op);
  for (const std::string& name : registered_ops()) {
    INFO("add a row for ", name, " to tests/op_cases");
    CHECK(rows.count(name) == 1);
  }
}

TEST_CASE("rows have names of their own") {
  std::set<std::string> names;
  for (const OpCase& row : op_cases()) {
    CAPTURE(row.name());
    CHECK(names.insert(row.name()).second);
  }
}

TEST_CASE("ops agree with float64") {
  for (const OpCase& row : op_cases()) {
    SUBCASE(row.name().c_str()) {
      const CaseResult result = check(row, Thorough::full);
      CHECK_MESSAGE(result.passed, row.name(), ": ", result.worst);
    }
  }
}
