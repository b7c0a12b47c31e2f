// Variants held to the op rows.
#include "tests/op_cases/candidates.h"

#include <cstring>

#include "runtime/error.h"

namespace cloam {
namespace {

Tensors results(const OpCase& row) {
  const Tensors in = make_inputs(row, row.inputs);
  const Tensor out = row.run(in);
  Tensors all = {out}, wanted;
  for (const Tensor& x : in)
    if (x.tracked()) wanted.push_back(x);
  if (row.gradient && out.tracked() && !wanted.empty())
    for (const Tensor& g : grad(sum(out * out), wanted)) all.push_back(g);
  eval(all);
  return all;
}

std::string compare(const Place& place, const Variant& built_in, const Variant& candidate, const OpCase& row) {
  prefer(place.first, place.second, built_in, "tried");
  const std::vector<uint32_t> wanted = bits_of(row);
  prefer(place.first, place.second, candidate, "tried");
  try {
    if (bits_of(row) != wanted) return text("other bits than the built-in variant in row ", row.name());
    const CaseResult checked = check(row, Thorough::quick);
    return checked.passed ? "" : text("wrong in row ", row.name(), ": ", checked.worst);
  } catch (const Error& error) { return text("row ", row.name(), ": ", error.what()); }
}

}  // namespace

std::vector<uint32_t> bits_of(const OpCase& row) {
  std::vector<uint32_t> bits;
  for (const Tensor& t : results(row)) {
    if (t.dtype() != DType::f32) continue;
    for (const float value : t.to_host()) {
      bits.emplace_back();
      std::memcpy(&bits.back(), &value, sizeof value);
    }
  }
  return bits;
}

RowsByPlace rows_by_choice() {
  RowsByPlace out;
  for (const OpCase& row : op_cases())
    for (const Choice& choice : choices_of([&] { (void)results(row); }))
      out[{choice.family, choice.size}].push_back(&row);
  return out;
}

std::string reject(const Place& place, const Variant& candidate, const RowsByPlace& rows) {
  const Variant& built_in = *candidates(place.first, place.second)[0];
  if (&candidate == &built_in) return {};
  const auto found = rows.find(place);
  if (found == rows.end()) return "no op row makes this choice, so nothing can check it";
  std::string why;
  for (const OpCase* row : found->second)
    if (why.empty()) why = compare(place, built_in, candidate, *row);
  prefer(place.first, place.second, built_in, "built-in");
  return why;
}

}  // namespace cloam
