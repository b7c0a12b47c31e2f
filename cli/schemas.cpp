// See schemas.h.
#include "cli/schemas.h"

#include <algorithm>

#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {

struct SchemaSource {
  const char *stem, *text;
};
extern const SchemaSource kSchemaSources[];  // generated from schemas/*.json; a row of nothing is the last

std::vector<std::string> schema_names() {
  std::vector<std::string> names;
  for (const SchemaSource* source = kSchemaSources; source->stem; ++source) names.push_back(source->stem);
  std::sort(names.begin(), names.end());
  return names;
}

std::string schema_named(const std::string& name) {
  for (const SchemaSource* source = kSchemaSources; source->stem; ++source)
    if (name == source->stem) return source->text;
  throw Error(Fault::usage, text("there is no schema ", name, did_you_mean(name, schema_names()), "\n  want one of ",
                                 joined(schema_names())));
}

}  // namespace cloam
