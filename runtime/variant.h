// Variants: the shapes of execution that a kernel file offers, stated as lines of its own text and read from there.
//
//   //: variant <kernel> <class> <size> NAME=VALUE ...
//   //: variant matmul_blocked cpu wide MR=4 NV=4 KC=256
//   //: variant matmul_blocked cpu wide MR=8 NV=2 KC=256     another choice of constants, for `cloam tune`
//   //: variant matmul_reference reference any
//   //: variant mlp_composed reference any                  no kernel: the op's composition (NAME_composed)
//
// class: cpu, gpu, or reference (version 1, which tests compare with). size: a size class that the op's code tells from
// shapes, "any" for all. A family is a stem with its _cpu and _gpu files. LANES, where it is stated, is the number of
// work-items in a group: rows of more than the device can have do not fit. The first row that fits is the built-in
// choice; further rows of the same kernel, class and size must give the same bits, so that neither tuning nor the
// device's largest group ever changes a result.
#pragma once
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "runtime/device.h"

namespace cloam {

/// Compile-time constants of a variant (tile sizes, widths): never tensor extents or scalars.
using Constants = std::vector<std::pair<const char*, int>>;

struct Variant {
  std::string stem, kernel, where, size;  // where: cpu, gpu or reference
  Constants constants;
  int operator[](const char* name) const;  // throws Fault::internal for a constant the row does not state
  std::string row() const;                 // as the file states it
};

/// What runs here for an op of this family and size class: the tuned row if there is one, else the first that fits the
/// device class, else a reference. Cheap enough for every launch. The names are literals.
const Variant& choose(const char* family, const char* size = "any");

/// One choice that was made, and why it fell as it did: "built-in", "tuned", "tried", "reference asked for", ...
struct Choice {
  std::string family, size;
  const Variant* variant = nullptr;
  std::string why;
};
/// Choices made while `work` ran, each once, in order of first use.
template <class Work>
std::vector<Choice> choices_of(const Work& work);

/// The rows that may serve in the place of choose(family, size) here, the built-in one first.
std::vector<const Variant*> candidates(const std::string& family, const std::string& size);
/// From now on `variant`, one of the candidates, serves; `why` is what explain says of it.
void prefer(const std::string& family, const std::string& size, const Variant& variant, const char* why);

/// From now on these families run their references (version 1, or the composition), and no others do: selftest found
/// their variants wrong on this device.
void switch_off(const std::vector<std::string>& families);
/// Whether a family runs its reference: it is switched off, or CLOAM_VARIANT=reference asks for all.
bool runs_reference(const char* family);

/// Every row of every kernel file. Throws Fault::internal for one that cannot be read.
std::vector<Variant> all_variants();
/// Does the kernel file hold the kernel that the row names (or is it a composition)?
bool states_kernel(const Variant& variant);

/// Where tuned choices of this device and driver lie: $CLOAM_CACHE_DIR or $XDG_CACHE_HOME/cloam or ~/.cache/cloam.
/// CLOAM_TUNE=off ignores the file. Rows that the kernel files no longer state are passed over.
std::string tuned_file();
/// What tuned_file() is to hold from now on: its choices, with these in the place of earlier ones of the same family
/// and size.
std::string with_tuned(const std::vector<Choice>& tuned);

void record_choices(std::vector<Choice>* into);  // this thread's; null: stop
/// Kernels that this thread launches from now on, each once: "FILE.cl: KERNEL", or "generated: OP". Null: stop.
void record_kernels(std::set<std::string>* into);

template <class Work>
std::vector<Choice> choices_of(const Work& work) {
  std::vector<Choice> made;
  record_choices(&made);
  try {
    work();
  } catch (...) {
    record_choices(nullptr);
    throw;
  }
  record_choices(nullptr);
  return made;
}

}  // namespace cloam
