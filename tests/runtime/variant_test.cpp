// Variants: rows of the kernel files are sound, and another row of a choice changes no bit.
#include "runtime/variant.h"

#include <doctest/doctest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "runtime/error.h"
#include "tests/op_cases/candidates.h"

using namespace cloam;

TEST_CASE("every variant row names a kernel of its file") {
  const std::vector<Variant> all = all_variants();
  CHECK(!all.empty());
  for (const Variant& variant : all) {
    CAPTURE(variant.row());
    CHECK(states_kernel(variant));
  }
}

TEST_CASE("candidates of one choice give the bits of the built-in variant") {
  const RowsByPlace rows = rows_by_choice();
  for (const auto& [place, met] : rows)
    for (const Variant* variant : candidates(place.first, place.second)) {
      CAPTURE(place.first);
      CAPTURE(variant->row());
      CHECK(reject(place, *variant, rows) == "");
    }
}

TEST_CASE("a choice follows what was preferred, and says so") {
  for (const auto& [place, met] : rows_by_choice()) {
    const std::vector<const Variant*> rows = candidates(place.first, place.second);
    if (rows.size() < 2) continue;
    prefer(place.first, place.second, *rows[1], "tried");
    const std::vector<Choice> made = choices_of([&, &row = *met[0]] { (void)bits_of(row); });
    prefer(place.first, place.second, *rows[0], "built-in");
    bool seen = false;
    for (const Choice& choice : made)
      seen |= choice.family == place.first && choice.size == place.second && choice.variant == rows[1] &&
              choice.why == "tried";
    CHECK(seen);
    return;
  }
}
