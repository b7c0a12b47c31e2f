// Memory that processes of one host have in common.
#pragma once
#include <memory>

#include "models/train/ranks.h"

namespace cloam {

/// `bytes` that begin with a page and that every rank sees and may change, zeros at first. Null on all ranks where they
/// do not run on one host, where one of them does not `want` it, and of one or pretended ranks. Every rank calls it.
/// Nothing of it is left behind when the ranks end, however they do.
std::shared_ptr<std::byte> shared_memory(const Ranks& ranks, size_t bytes, bool wants);

}  // namespace cloam
