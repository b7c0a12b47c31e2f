// The viewer's work on the device: one thread does it all, in the order of urgency; what is no longer wanted is
// dropped.
#pragma once
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <future>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>

namespace cloam {

/// What the viewer answers over HTTP.
struct Answer {
  std::string body, type = "application/json";
  std::map<std::string, std::string> headers = {};
};

/// An error of a request, with its HTTP status.
class Refused : public std::runtime_error {
 public:
  Refused(int status, const std::string& why) : std::runtime_error(why), status_(status) {}
  int status() const { return status_; }

 private:
  int status_;
};

/// The most urgent first. `edit` changes what is seen: frames that wait or are being rendered are dropped.
enum class Urgency { edit, quick, coarse, middle, thumbnail, fine };

struct Job {
  Urgency urgency = Urgency::quick;
  std::string client = "";  // of frames
  int64_t number = 0;       // of frames; a client's higher one drops those before
  /// Long work calls between() between its parts; it throws Refused (409) when the job is dropped.
  std::function<Answer(const std::function<void()>& between)> make;
};

class JobQueue {
 public:
  /// From any thread. What make() throws comes through the future; Refused (409) for what is dropped, Refused (503)
  /// once the queue is closed.
  std::future<Answer> add(Job job);
  /// From here on jobs are refused in their midst, and run_until returns, when ended(). Before the first job.
  void stop_when(std::function<bool()> ended) { ended_ = std::move(ended); }
  /// Does jobs until it is to stop, which is asked every tenth of a second.
  void run_until_stopped();
  /// Does the jobs that wait, but begins none after this many seconds.
  void run_for(double seconds);
  /// From any thread: whatever waits, and whatever comes, is refused.
  void close();

 private:
  struct Waiting {
    Job job;
    std::promise<Answer> promise;
    std::atomic<bool> dropped = false;
  };
  using Place = std::shared_ptr<Waiting>;

  void drop_frames(const std::function<bool(const Job&)>& which);
  Place take(Urgency least);
  void run(const Place& waiting);
  void pause(const Waiting& running);

  std::mutex mutex_;
  std::condition_variable more_;
  std::list<Place> waiting_;
  std::list<Place> running_;               // the innermost last: urgent jobs run between the parts of others
  std::map<std::string, int64_t> newest_;  // number of each client
  bool closed_ = false;
  std::function<bool()> ended_ = [] { return false; };
};

}  // namespace cloam
