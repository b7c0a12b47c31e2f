// FNV-1a, for names of generated kernels and of files in the cache folder: short, and the same on every machine.
#pragma once
#include <cstdint>
#include <string_view>

namespace cloam {

/// `hash` goes on from an earlier text.
inline uint64_t fnv1a(std::string_view text, uint64_t hash = 1469598103934665603ull) {
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211ull;
  return hash;
}

}  // namespace cloam
