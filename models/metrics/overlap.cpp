// See overlap.h.
#include "models/metrics/overlap.h"

#include <limits>
#include <map>

#include "runtime/error.h"

namespace cloam {
namespace {

struct Counts {
  std::size_t shown = 0, truth = 0, both = 0;

  double overlap() const { return static_cast<double>(both) / static_cast<double>(shown + truth - both); }
};

}  // namespace

double mean_overlap(std::span<const int> shown, std::span<const int> truth, std::size_t least) {
  if (shown.size() != truth.size())
    throw Error(Fault::data, text("outlines of ", shown.size(), " and ", truth.size(), " pixels cannot be compared"));
  std::map<int, Counts> counts;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    counts[shown[i]].shown++;
    counts[truth[i]].truth++;
    if (shown[i] == truth[i]) counts[truth[i]].both++;
  }
  double sum = 0;
  std::size_t outlines = 0;
  for (const auto& [number, of] : counts)
    if (number != 0 && of.truth > 0 && of.truth >= least) sum += of.overlap(), ++outlines;
  return outlines > 0 ? sum / static_cast<double>(outlines) : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace cloam
