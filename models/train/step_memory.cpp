// See step_memory.h.
#include "models/train/step_memory.h"

#include "models/train/shared_memory.h"

namespace cloam {
namespace {

constexpr size_t kPage = 4096;

}  // namespace

std::optional<StepMemory> memory_in_common(const Ranks& ranks, const std::vector<Shape>& shapes,
                                           const SharedRows& rows) {
  if (ranks.size() == 1) return std::nullopt;
  const auto floats = static_cast<size_t>(flat_size(shapes));
  const size_t bytes = (floats * sizeof(float) + kPage - 1) / kPage * kPage;
  const bool wants = ranks.may_share_memory() && computes_in_host_memory();
  const std::shared_ptr<std::byte> memory = shared_memory(ranks, bytes * static_cast<size_t>(1 + ranks.size()), wants);
  if (!memory) return std::nullopt;
  // The parameters, then each rank's gradients.
  const auto block = [&](int64_t at) {
    return std::shared_ptr<std::byte>(memory, memory.get() + static_cast<size_t>(at) * bytes);
  };
  StepMemory out{flat_in(block(0), shapes), flat_in(block(1 + ranks.rank()), shapes), {}};
  const Share own{ranks.rank(), ranks.size()};
  for (int64_t rank = 0; rank < ranks.size(); ++rank) {
    const auto* const gradients = reinterpret_cast<const float*>(block(1 + rank).get());
    out.rows_of_ranks.emplace_back(gradients + own.begin(rows.count) * rows.width,
                                   static_cast<size_t>(own.size(rows.count) * rows.width));
  }
  return out;
}

}  // namespace cloam
