// Values in the host's memory that can be made again at any time: decoded images, LiDAR sweeps. What is held stays
// within a budget of bytes; what has not been used for longest goes first. Threads make ahead what is announced. Which
// values are held, and which thread made them, changes no value: only how long get() waits.
#pragma once
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

namespace cloam {

class HostStore {
 public:
  using Value = std::shared_ptr<const void>;
  /// Values of one kind, counted from 0. Both are called by several threads at once, and need no lock of the store.
  struct Kind {
    std::function<Value(std::size_t number)> make;      // may throw: get() does then, for that number alone
    std::function<uint64_t(std::size_t number)> bytes;  // that it takes
  };
  struct Use {
    uint64_t held = 0, most_held = 0;  // bytes, now and at the most
    uint64_t made = 0, waited = 0;     // values made, and those that get() had to make or to wait for
  };

  /// threads: that make values ahead; 0: none do.
  explicit HostStore(uint64_t budget, int threads = default_threads());
  /// Waits for the values that threads are making.
  ~HostStore();
  HostStore(const HostStore&) = delete;
  HostStore& operator=(const HostStore&) = delete;

  /// The kind's place, for get() and want().
  std::size_t add(Kind kind);
  /// The value, made now if it is neither held nor being made. It lives as long as the caller keeps it, also where the
  /// store has no room for it. Errors are those of Kind::make.
  Value get(std::size_t kind, std::size_t number);
  /// It will be asked for at that moment (a step's number): it is made ahead as far as what is announced fits into the
  /// budget, and then held until that moment has passed.
  void want(std::size_t kind, std::size_t number, int64_t moment);
  /// What was announced for earlier moments is no longer waited for.
  void begin(int64_t moment);

  uint64_t budget() const { return budget_; }
  Use use() const;
  /// Half of the cores, from 1 to 8: kernels of CPU devices need the others.
  static int default_threads();

 private:
  using Place = std::pair<std::size_t, std::size_t>;  // kind, number
  struct Held {
    Value value;
    uint64_t bytes;
    std::list<Place>::iterator age;
  };
  void make_ahead();
  /// The next announced value that fits beside the others that were announced; null: none does.
  const Place* next_wanted();
  bool is_due(const Place& place) const;
  Value make(std::unique_lock<std::mutex>& lock, const Place& place);
  void hold(const Place& place, const Value& value);
  void make_room(uint64_t bytes);

  const uint64_t budget_;
  mutable std::mutex mutex_;
  std::condition_variable wanted_, made_;
  std::deque<Kind> kinds_;  // a reference to one holds while others are added
  std::map<Place, Held> held_;
  std::list<Place> ages_;  // of held_, the one used longest ago first
  std::map<Place, int> making_;
  std::map<Place, int64_t> due_;  // announced, by moment
  std::deque<Place> queue_;       // announced and not begun
  int64_t moment_ = 0;
  Use use_;
  bool ends_ = false;
  std::vector<std::thread> threads_;
};

/// A list of values: all in memory, or as many as a store has room for.
template <class T>
class Stored {
 public:
  Stored(std::vector<T> all)  // NOLINT: a list in memory is one
      : count_(all.size()), all_(std::make_shared<const std::vector<T>>(std::move(all))) {}
  /// make(number) gives a T; bytes(number) is what it takes.
  template <class Make>
  Stored(std::shared_ptr<HostStore> store, std::size_t count, Make make, std::function<uint64_t(std::size_t)> bytes)
      : count_(count), store_(std::move(store)) {
    kind_ = store_->add({[make](std::size_t number) { return std::make_shared<const T>(make(number)); }, bytes});
  }

  std::size_t size() const { return count_; }
  /// Null: all are in memory.
  const std::shared_ptr<HostStore>& store() const { return store_; }
  std::shared_ptr<const T> operator[](std::size_t number) const {
    if (all_) return {all_, &all_->at(number)};
    return std::static_pointer_cast<const T>(store_->get(kind_, number));
  }
  /// As HostStore::want and begin.
  void want(std::size_t number, int64_t moment) const {
    if (store_) store_->want(kind_, number, moment);
  }
  void begin(int64_t moment) const {
    if (store_) store_->begin(moment);
  }

 private:
  std::size_t count_, kind_ = 0;
  std::shared_ptr<const std::vector<T>> all_;  // null: the store has them
  std::shared_ptr<HostStore> store_;
};

}  // namespace cloam
