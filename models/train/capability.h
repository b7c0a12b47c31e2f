// Capabilities: what a method may be besides a Method. Each is a base class with a header of its own; a method has it
// or has not, and nothing stands in for those that it lacks.
#pragma once
#include "models/train/method.h"

namespace cloam {

/// The method as one that has the capability; null: it has not.
template <class Capability>
Capability* as(Method& method) {
  return dynamic_cast<Capability*>(&method);
}

}  // namespace cloam
