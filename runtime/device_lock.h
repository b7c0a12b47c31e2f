// Threads and the device: one thread at a time uses it, and with it the plans, the pool, the kernels and the records of
// this process.
#pragma once
#include <memory>
#include <mutex>

namespace cloam {

/// Held by every function of runtime/ that evaluates, launches, or reads or writes the device's memory or what the
/// process knows of it. It is recursive: such functions call each other. A graph is built without it, for a node does
/// not change after it was made but by who holds the lock. Whoever holds it waits for no other thread.
class DeviceLock {
 public:
  DeviceLock() : held_(mutex()) {}
  DeviceLock(const DeviceLock&) = delete;
  DeviceLock& operator=(const DeviceLock&) = delete;
  /// In a process that was just forked: whoever held it is no thread of this one.
  static void renew() { std::construct_at(&mutex()); }

 private:
  static std::recursive_mutex& mutex() {
    static auto* const one = new std::recursive_mutex;  // outlives every tensor that is destroyed at exit
    return *one;
  }
  std::scoped_lock<std::recursive_mutex> held_;
};

}  // namespace cloam
