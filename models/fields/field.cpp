// The kinds of fields by name.
#include "models/fields/field.h"

#include "models/fields/encoded_field.h"
#include "models/fields/frequency_field.h"
#include "runtime/error.h"

namespace cloam {

std::unique_ptr<Field> make_field(const Scope& scope, const FieldOptions& options) {
  if (options.kind == "hash" || options.kind == "triplane") return std::make_unique<EncodedField>(scope, options);
  if (options.kind == "frequency") return std::make_unique<FrequencyField>(scope, options);
  throw Error(Fault::usage, text("setting field.kind: \"", options.kind, "\", want hash, frequency or triplane"));
}

}  // namespace cloam
