// See view_jobs.h.
#include "cli/view_jobs.h"

#include <algorithm>
#include <chrono>

namespace cloam {
namespace {

constexpr std::size_t kMostClients = 256;  // whose numbers are remembered

Refused superseded() { return {409, "superseded"}; }
Refused closing() { return {503, "the viewer is ending"}; }

bool is_frame(const Job& job) { return !job.client.empty(); }

}  // namespace

/// With the lock held.
void JobQueue::drop_frames(const std::function<bool(const Job&)>& which) {
  for (const Place& running : running_)
    if (is_frame(running->job) && which(running->job)) running->dropped = true;
  waiting_.remove_if([&](const Place& waiting) {
    if (!is_frame(waiting->job) || !which(waiting->job)) return false;
    waiting->promise.set_exception(std::make_exception_ptr(superseded()));
    return true;
  });
}

std::future<Answer> JobQueue::add(Job job) {
  const auto waiting = std::make_shared<Waiting>();
  std::future<Answer> answer = waiting->promise.get_future();
  const std::lock_guard lock(mutex_);
  if (closed_) {
    waiting->promise.set_exception(std::make_exception_ptr(closing()));
    return answer;
  }
  if (job.urgency == Urgency::edit) drop_frames([](const Job&) { return true; });
  if (is_frame(job)) {
    if (newest_.size() >= kMostClients && !newest_.contains(job.client)) newest_.clear();
    int64_t& newest = newest_.try_emplace(job.client, job.number).first->second;
    if (job.number < newest) {
      waiting->promise.set_exception(std::make_exception_ptr(superseded()));
      return answer;
    }
    newest = job.number;
    drop_frames([&](const Job& other) { return other.client == job.client && other.number < job.number; });
  }
  waiting->job = std::move(job);
  waiting_.push_back(waiting);
  more_.notify_all();
  return answer;
}

/// The first of the most urgent, as urgent as `least` or more; null: none. With the lock held.
JobQueue::Place JobQueue::take(Urgency least) {
  const auto first = std::min_element(waiting_.begin(), waiting_.end(),
                                      [](const Place& a, const Place& b) { return a->job.urgency < b->job.urgency; });
  if (first == waiting_.end() || (*first)->job.urgency > least) return nullptr;
  const Place taken = *first;
  waiting_.erase(first);
  running_.push_back(taken);
  return taken;
}

void JobQueue::run(const Place& waiting) {
  try {
    waiting->promise.set_value(waiting->job.make([&] { pause(*waiting); }));
  } catch (...) { waiting->promise.set_exception(std::current_exception()); }
  const std::lock_guard lock(mutex_);
  running_.remove(waiting);
}

/// What is quick and what is coarse need not wait for a fine frame. An edit does: it drops the frame.
void JobQueue::pause(const Waiting& running) {
  for (;;) {
    if (running.dropped) throw superseded();
    if (ended_()) throw closing();
    Place next;
    {
      const std::lock_guard lock(mutex_);
      const bool waits_for_edit = std::any_of(waiting_.begin(), waiting_.end(),
                                              [](const Place& place) { return place->job.urgency == Urgency::edit; });
      if (running.job.urgency > Urgency::coarse && !waits_for_edit) next = take(Urgency::coarse);
    }
    if (!next) return;
    run(next);
  }
}

void JobQueue::run_until_stopped() {
  while (!ended_()) {
    Place next;
    {
      std::unique_lock lock(mutex_);
      if (waiting_.empty()) more_.wait_for(lock, std::chrono::milliseconds(100));
      next = take(Urgency::fine);
    }
    if (next) run(next);
  }
}

void JobQueue::run_for(double seconds) {
  const auto begin = std::chrono::steady_clock::now();
  const auto passed = [&] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count(); };
  while (passed() < seconds) {
    Place next;
    {
      const std::lock_guard lock(mutex_);
      next = take(Urgency::fine);
    }
    if (!next) return;
    run(next);
  }
}

void JobQueue::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
  for (const Place& waiting : waiting_) waiting->promise.set_exception(std::make_exception_ptr(closing()));
  waiting_.clear();
}

}  // namespace cloam
