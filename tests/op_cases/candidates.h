// Variants held to the op rows: which rows meet a choice, and whether another variant in its place changes a bit.
#pragma once
#include <map>
#include <utility>

#include "runtime/variant.h"
#include "tests/op_cases/op_cases.h"

namespace cloam {

using Place = std::pair<std::string, std::string>;  // family and size class of a choice
using RowsByPlace = std::map<Place, std::vector<const OpCase*>>;

/// Runs every row once and notes the choices that it makes.
RowsByPlace rows_by_choice();
/// The bits of a row's result and of its gradients: all that a variant could change.
std::vector<uint32_t> bits_of(const OpCase& row);
/// Why `candidate` may not serve at `place`, or nothing: a row that it gets wrong, or to which it gives other bits than
/// the built-in variant; no row that meets the choice. The built-in variant is never rejected.
std::string reject(const Place& place, const Variant& candidate, const RowsByPlace& rows);

}  // namespace cloam
