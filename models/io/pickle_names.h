// The closed lists of names that pickles may hold, by what they are read for.
#pragma once
#include <span>
#include <string_view>

#include "models/io/pickle.h"

namespace cloam {

struct AllowedName {
  std::string_view spelling;  // module, space, name
  PickleName name;
};

struct Dialect {
  std::span<const AllowedName> names;
  const char *only, *what;  // for errors
};

const Dialect& dialect_of(PickleUse use);

}  // namespace cloam
