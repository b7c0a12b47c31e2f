// The viewer's HTTP server: on the loopback interface, for whoever knows its token. docs/viewer.md has its requests.
#pragma once
#include <atomic>
#include <memory>
#include <string>

#include "cli/view_events.h"
#include "cli/view_shown.h"

namespace cloam {

class ViewServer {
 public:
  /// Answers from here on, in threads of its own; what needs the device goes through `jobs`. All must outlive this.
  /// port 0: any that is free. Fault::usage for a port that is taken.
  ViewServer(Shown& shown, JobQueue& jobs, Events& events, int port);
  /// Refuses what waits, tells pages that it ends, and waits for the last answers.
  ~ViewServer();
  ViewServer(const ViewServer&) = delete;
  ViewServer& operator=(const ViewServer&) = delete;

  /// "http://127.0.0.1:PORT/TOKEN/".
  const std::string& address() const;
  int port() const;
  /// Whether a page asked for the end.
  bool was_asked_to_quit() const;

 private:
  class Service;
  std::unique_ptr<Service> service_;
};

}  // namespace cloam
