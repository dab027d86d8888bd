// SPDX-License-Identifier: Apache-2.0
//
// A queue between two threads.

#ifndef UDP_BRIDGE_CPP_IO_BOUNDED_QUEUE_HPP
#define UDP_BRIDGE_CPP_IO_BOUNDED_QUEUE_HPP

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <utility>

namespace udp_bridge_cpp {

/// The cost of an element where all cost the same.
struct One {
  template <class T>
  std::size_t operator()(const T&) const {
    return 1;
  }
};

/// A first-in first-out queue with a bound. What does not fit is dropped and counted.
template <class T, class Cost = One>
class BoundedQueue {
 public:
  /// All elements together cost `capacity` at most. `wake` is called after a `push` to an empty
  /// queue.
  BoundedQueue(std::size_t capacity, std::function<void()> wake)
      : capacity_(capacity), wake_(std::move(wake)) {}

  /// Append an element; return false where the queue is full.
  bool push(T&& element) {
    bool was_empty = false;
    {
      const std::lock_guard lock(mutex_);
      const std::size_t cost = Cost{}(element);
      if (cost_ + cost > capacity_) {
        ++dropped_;
        return false;
      }
      cost_ += cost;
      was_empty = elements_.empty();
      elements_.push_back(std::move(element));
    }
    if (was_empty) wake_();
    return true;
  }

  /// Return all elements; the reader takes them at once, so one lock serves many.
  std::deque<T> take_all() {
    const std::lock_guard lock(mutex_);
    cost_ = 0;
    return std::exchange(elements_, {});
  }

  std::uint64_t dropped() const {
    const std::lock_guard lock(mutex_);
    return dropped_;
  }

 private:
  const std::size_t capacity_;
  const std::function<void()> wake_;
  mutable std::mutex mutex_;
  std::deque<T> elements_;
  std::size_t cost_ = 0;
  std::uint64_t dropped_ = 0;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_IO_BOUNDED_QUEUE_HPP
