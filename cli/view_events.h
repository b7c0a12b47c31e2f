// What the viewer tells its pages as it happens: server-sent events.
#pragma once
#include <condition_variable>
#include <cstdint>
#include <map>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace cloam {

class Events {
 public:
  /// From any thread. Of each kind ("revision", "training", "end") the last is kept: whoever comes late hears it.
  void tell(const std::string& kind, const nlohmann::ordered_json& event);

  /// Nothing follows it; the first one that is told stays.
  void end(const std::string& why);

  struct News {
    std::string lines;     // as text/event-stream; a comment where there is nothing new
    uint64_t seen = 0;     // up to here
    bool is_last = false;  // the end was told
  };
  /// Waits for what was told after `seen`, but not for more than a few seconds.
  News after(uint64_t seen);

 private:
  struct Event {
    uint64_t place = 0;
    std::string line;
  };
  std::mutex mutex_;
  std::condition_variable more_;
  std::map<std::string, Event> latest_;  // by kind
  uint64_t count_ = 0;
};

}  // namespace cloam
