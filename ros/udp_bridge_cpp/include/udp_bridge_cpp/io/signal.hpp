// SPDX-License-Identifier: Apache-2.0
//
// A signal that wakes a thread with several queues.

#ifndef UDP_BRIDGE_CPP_IO_SIGNAL_HPP
#define UDP_BRIDGE_CPP_IO_SIGNAL_HPP

#include <chrono>
#include <condition_variable>
#include <mutex>

namespace udp_bridge_cpp {

/// Wakes one waiting thread; remembers a call that came before the wait.
class Signal {
 public:
  void notify() {
    {
      const std::lock_guard lock(mutex_);
      is_set_ = true;
    }
    condition_.notify_one();
  }

  /// Wait for `notify`, at most so long.
  void wait(std::chrono::nanoseconds most) {
    std::unique_lock lock(mutex_);
    condition_.wait_for(lock, most, [&] { return is_set_; });
    is_set_ = false;
  }

 private:
  std::mutex mutex_;
  std::condition_variable condition_;
  bool is_set_ = false;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_IO_SIGNAL_HPP
