// SPDX-License-Identifier: Apache-2.0
//
// Budget of resends: repair must not take more of a link than it brings.

#ifndef UDP_BRIDGE_CPP_SENDER_RESEND_BUDGET_HPP
#define UDP_BRIDGE_CPP_SENDER_RESEND_BUDGET_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <utility>

#include "udp_bridge.hpp"

namespace udp_bridge_cpp {

/// Limits resends to a quarter of the reported goodput, with bursts.
class ResendBudget {
 public:
  void sent(std::size_t size, std::int64_t now_nanos) { sent_.add(size, now_nanos); }

  void goodput_reported(std::uint32_t goodput, std::int64_t now_nanos) {
    goodputs_.emplace_back(now_nanos, goodput);
    while (goodputs_.size() > kMaxGoodputs || goodputs_.front().first <= now_nanos - kWindowNanos) {
      goodputs_.pop_front();
    }
  }

  /// Take bytes from the budget; return whether they were available.
  bool spend(std::size_t size, std::int64_t now_nanos) {
    sent_.forget(now_nanos);
    spent_.forget(now_nanos);
    std::size_t best = 0;
    for (const auto& [at, goodput] : goodputs_) best = std::max<std::size_t>(best, goodput);
    const std::size_t most = std::max({std::min(best, sent_.total / kWindowSeconds),
                                       std::min(kBurstBytes, sent_.total), kMinimumBytes});
    if (spent_.total + size > most) return false;
    spent_.add(size, now_nanos);
    return true;
  }

 private:
  static constexpr std::int64_t kWindowSeconds = 4;
  static constexpr std::int64_t kWindowNanos = kWindowSeconds * udp_bridge::kNanos;
  static constexpr std::size_t kBurstBytes = 1 << 20;
  static constexpr std::size_t kMinimumBytes = 131072;
  static constexpr std::size_t kMaxGoodputs = 256;

  struct RecentBytes {
    std::size_t total = 0;
    std::deque<std::pair<std::int64_t, std::size_t>> items;  // time, bytes

    void add(std::size_t size, std::int64_t now_nanos) {
      forget(now_nanos);
      items.emplace_back(now_nanos, size);
      total += size;
    }
    void forget(std::int64_t now_nanos) {
      while (!items.empty() && items.front().first <= now_nanos - kWindowNanos) {
        total -= items.front().second;
        items.pop_front();
      }
    }
  };

  RecentBytes sent_, spent_;
  std::deque<std::pair<std::int64_t, std::uint32_t>> goodputs_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_SENDER_RESEND_BUDGET_HPP
