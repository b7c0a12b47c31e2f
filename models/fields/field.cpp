// The kinds of fields by name.
#include "models/fields/field.h"

#include "models/fields/frequency_field.h"
#include "models/fields/hash_field.h"
#include "models/fields/triplane_field.h"
#include "runtime/error.h"

namespace cloam {

std::unique_ptr<Field> make_field(const Scope& scope, const FieldOptions& options) {
  if (options.kind == "hash") return std::make_unique<HashField>(scope, options);
  if (options.kind == "frequency") return std::make_unique<FrequencyField>(scope, options);
  if (options.kind == "triplane") return std::make_unique<TriplaneField>(scope, options);
  throw Error(Fault::usage, text("setting field.kind: \"", options.kind, "\", want hash, frequency or triplane"));
}

}  // namespace cloam
