// See host_store.h.
#include "models/io/host_store.h"

#include <algorithm>

namespace cloam {

int HostStore::default_threads() { return std::clamp(static_cast<int>(std::thread::hardware_concurrency()) / 2, 1, 8); }

HostStore::HostStore(uint64_t budget, int threads) : budget_(budget) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { make_ahead(); });
}

HostStore::~HostStore() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  wanted_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

std::size_t HostStore::add(Kind kind) {
  const std::lock_guard lock(mutex_);
  kinds_.push_back(std::move(kind));
  return kinds_.size() - 1;
}

HostStore::Value HostStore::get(std::size_t kind, std::size_t number) {
  const Place place{kind, number};
  std::unique_lock lock(mutex_);
  const bool ready = held_.contains(place);
  if (!ready) ++use_.waited;
  made_.wait(lock, [&] { return !making_.contains(place); });
  if (const auto found = held_.find(place); found != held_.end()) {
    ages_.splice(ages_.end(), ages_, found->second.age);
    return found->second.value;
  }
  return make(lock, place);
}

void HostStore::want(std::size_t kind, std::size_t number, int64_t moment) {
  const Place place{kind, number};
  const std::lock_guard lock(mutex_);
  const auto [due, is_new] = due_.try_emplace(place, moment);
  due->second = std::max(due->second, moment);
  const bool queued = std::find(queue_.begin(), queue_.end(), place) != queue_.end();
  if (queued || held_.contains(place) || making_.contains(place)) return;
  queue_.push_back(place);
  wanted_.notify_one();
}

void HostStore::begin(int64_t moment) {
  const std::lock_guard lock(mutex_);
  moment_ = moment;
  std::erase_if(due_, [&](const auto& one) { return one.second < moment; });
  std::erase_if(queue_, [&](const Place& place) { return !due_.contains(place); });
  wanted_.notify_all();  // what was held for earlier moments may go
}

HostStore::Use HostStore::use() const {
  const std::lock_guard lock(mutex_);
  return use_;
}

bool HostStore::is_due(const Place& place) const {
  const auto due = due_.find(place);
  return due != due_.end() && due->second >= moment_;
}

const HostStore::Place* HostStore::next_wanted() {
  while (!queue_.empty() && (held_.contains(queue_.front()) || making_.contains(queue_.front()))) queue_.pop_front();
  if (queue_.empty()) return nullptr;
  const auto bytes_of = [&](const Place& place) { return kinds_[place.first].bytes(place.second); };
  uint64_t announced = bytes_of(queue_.front());
  for (const auto& [place, value] : held_)
    if (is_due(place)) announced += value.bytes;
  for (const auto& [place, threads] : making_) announced += bytes_of(place);
  return announced <= budget_ ? &queue_.front() : nullptr;
}

void HostStore::make_ahead() {
  std::unique_lock lock(mutex_);
  for (;;) {
    const Place* next = nullptr;
    wanted_.wait(lock, [&] { return ends_ || (next = next_wanted()); });
    if (ends_) return;
    const Place place = *next;
    queue_.pop_front();
    try {
      make(lock, place);
    } catch (...) {}  // whoever asks for it makes it again, and is told
  }
}

/// Without the lock while it is made.
HostStore::Value HostStore::make(std::unique_lock<std::mutex>& lock, const Place& place) {
  const Kind& kind = kinds_[place.first];
  making_.emplace(place, 1);
  ++use_.made;
  Value value;
  std::exception_ptr trouble;
  lock.unlock();
  try {
    value = kind.make(place.second);
  } catch (...) { trouble = std::current_exception(); }
  lock.lock();
  making_.erase(place);
  if (value) hold(place, value);
  made_.notify_all();
  if (trouble) std::rethrow_exception(trouble);
  return value;
}

/// As far as there is room beside what was announced.
void HostStore::hold(const Place& place, const Value& value) {
  const uint64_t bytes = kinds_[place.first].bytes(place.second);
  make_room(bytes);
  if (use_.held + bytes > budget_) return;
  held_[place] = {value, bytes, ages_.insert(ages_.end(), place)};
  use_.held += bytes;
  use_.most_held = std::max(use_.most_held, use_.held);
}

void HostStore::make_room(uint64_t bytes) {
  if (bytes > budget_) return;
  for (auto age = ages_.begin(); age != ages_.end() && use_.held + bytes > budget_;) {
    const Place place = *age++;
    if (is_due(place)) continue;
    const auto old = held_.find(place);
    use_.held -= old->second.bytes;
    ages_.erase(old->second.age);
    held_.erase(old);
  }
}

}  // namespace cloam
