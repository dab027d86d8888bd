// SPDX-License-Identifier: Apache-2.0
//
// Round-trip time of repair, and the timeouts that follow from it.

#ifndef UDP_BRIDGE_CPP_RECEIVER_ROUND_TRIP_HPP
#define UDP_BRIDGE_CPP_RECEIVER_ROUND_TRIP_HPP

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace udp_bridge_cpp {

/// Time from a request to the requested part (RFC 6298).
class RoundTrip {
 public:
  void add(std::int64_t nanos) {
    const auto measured = static_cast<double>(nanos);
    if (nanos_ == 0) {
      nanos_ = measured;
      deviation_ = measured / 2;
      return;
    }
    deviation_ += (std::abs(measured - nanos_) - deviation_) / 4;
    nanos_ += (measured - nanos_) / 8;
  }

  /// Delay from the detection of a gap to its request.
  std::int64_t debounce_nanos() const {
    if (nanos_ == 0) return kMillisecond;
    return std::min(kMillisecond, static_cast<std::int64_t>(nanos_ / 4));
  }

  /// Time until a request is repeated that was preceded by `tries` others.
  std::int64_t wait_nanos(int tries) const {
    const double wait = nanos_ == 0 ? 50e6 : nanos_ + std::max(1e6, 4 * deviation_);
    return static_cast<std::int64_t>(std::min(wait * std::min(std::pow(1.5, tries), 3.0), 5e8));
  }

 private:
  static constexpr std::int64_t kMillisecond = 1000000;
  double nanos_ = 0, deviation_ = 0;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_RECEIVER_ROUND_TRIP_HPP
