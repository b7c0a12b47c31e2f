// See view_events.h.
#include "cli/view_events.h"

#include <chrono>
#include <nlohmann/json.hpp>

namespace cloam {

void Events::tell(const std::string& kind, const nlohmann::ordered_json& event) {
  const std::lock_guard lock(mutex_);
  latest_[kind] = {++count_, "data: " + event.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n\n"};
  more_.notify_all();
}

void Events::end(const std::string& why) {
  {
    const std::lock_guard lock(mutex_);
    if (latest_.contains("end")) return;
  }
  tell("end", {{"end", why}});
}

Events::News Events::after(uint64_t seen) {
  std::unique_lock lock(mutex_);
  more_.wait_for(lock, std::chrono::seconds(2), [&] { return count_ > seen; });
  std::map<uint64_t, std::string> lines;
  for (const auto& [kind, event] : latest_)
    if (event.place > seen) lines[event.place] = event.line;
  News news{lines.empty() ? ": still there\n\n" : "", count_, latest_.contains("end")};
  for (const auto& [place, line] : lines) news.lines += line;
  return news;
}

}  // namespace cloam
