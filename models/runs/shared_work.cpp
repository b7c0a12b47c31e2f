// See shared_work.h.
#include "models/runs/shared_work.h"

#include "models/runs/interrupted.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

/// What a rank made of its items, in their order, and the signal that stopped it; 0: none did.
struct Part {
  Report made = Report::array();
  int signal = 0;
};

Part own_part(const Ranks& ranks, const Listener& listener, const SharedWork& work) {
  Part part;
  try {
    for (auto item = static_cast<std::size_t>(ranks.rank()); item < work.count;
         item += static_cast<std::size_t>(ranks.size())) {
      listener.check_stop([&] { return work.complete(part.made.size()); });
      part.made.push_back(work.make(item));
      ranks.finish_piece();
    }
  } catch (const Interrupted& stopped) { part.signal = stopped.signal(); }
  return part;
}

/// CBOR keeps every bit of a number, also of those that JSON has no words for.
std::vector<Part> all_parts(const Ranks& ranks, Part mine) {
  if (ranks.size() == 1) return {std::move(mine)};
  const std::vector<std::uint8_t> bytes = Report::to_cbor({{"made", std::move(mine.made)}, {"signal", mine.signal}});
  ranks.await_work();
  std::vector<Part> parts;
  for (const std::string& part : gathered(ranks, std::string(bytes.begin(), bytes.end()))) {
    Report read = Report::from_cbor(part);
    parts.push_back({std::move(read.at("made")), read.at("signal").get<int>()});
  }
  return parts;
}

}  // namespace

std::vector<Report> share_out(const Ranks& ranks, const Listener& listener, const SharedWork& work) {
  std::vector<Part> parts = all_parts(ranks, own_part(ranks, listener, work));
  std::size_t done = 0;
  int signal = 0;
  for (const Part& part : parts) {
    done += part.made.size();
    if (signal == 0) signal = part.signal;
  }
  if (signal != 0) throw Interrupted(signal, "stopped: " + work.complete(done));
  std::vector<Report> made;
  for (std::size_t item = 0; item < work.count; ++item)
    made.push_back(std::move(parts[item % parts.size()].made.at(item / parts.size())));
  return made;
}

}  // namespace cloam
