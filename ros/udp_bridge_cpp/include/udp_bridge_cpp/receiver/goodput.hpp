// SPDX-License-Identifier: Apache-2.0
//
// Goodput: what a Request reports to the sender of lost parts.

#ifndef UDP_BRIDGE_CPP_RECEIVER_GOODPUT_HPP
#define UDP_BRIDGE_CPP_RECEIVER_GOODPUT_HPP

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "udp_bridge.hpp"

namespace udp_bridge_cpp {

/// Bytes that arrived from a sender within the last second.
class Goodput {
 public:
  void add(std::size_t size, std::int64_t now_nanos) {
    forget(now_nanos);
    bytes_[static_cast<std::size_t>(grain_) % bytes_.size()] += size;
  }

  std::uint32_t last_second(std::int64_t now_nanos) {
    forget(now_nanos);
    std::uint64_t sum = 0;
    for (const std::uint64_t bytes : bytes_) sum += bytes;
    return static_cast<std::uint32_t>(std::min<std::uint64_t>(sum, 0xFFFFFFFFu));
  }

 private:
  static constexpr std::int64_t kGrainNanos = udp_bridge::kNanos / 10;

  void forget(std::int64_t now_nanos) {
    const std::int64_t grain = now_nanos / kGrainNanos;
    const std::int64_t last = static_cast<std::int64_t>(bytes_.size());
    for (std::int64_t old = std::max(grain_ + 1, grain - last + 1); old <= grain; ++old) {
      bytes_[static_cast<std::size_t>(old) % bytes_.size()] = 0;
    }
    grain_ = grain;
  }

  std::array<std::uint64_t, 10> bytes_{};
  std::int64_t grain_ = 0;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_RECEIVER_GOODPUT_HPP
