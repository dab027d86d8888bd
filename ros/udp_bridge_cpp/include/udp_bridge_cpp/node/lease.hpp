// SPDX-License-Identifier: Apache-2.0
//
// A peer's lease on a topic of ROS.

#ifndef UDP_BRIDGE_CPP_NODE_LEASE_HPP
#define UDP_BRIDGE_CPP_NODE_LEASE_HPP

#include <cstdint>
#include <optional>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/node/ros_sample.hpp"

namespace udp_bridge_cpp {

/// One peer's lease on one topic. A rate limit never loses the last message, which may be a stop
/// command: the newest one is held until it is due.
struct Lease {
  std::int64_t renewed_nanos = 0;
  std::optional<std::int64_t> expires_nanos;
  std::int64_t period_nanos = 0, due_nanos = 0;
  std::optional<RosSample> held;

  void renew(const udp_bridge::Subscribe& request, std::int64_t now_nanos) {
    renewed_nanos = now_nanos;
    const float rate = request.max_rate_hz;
    period_nanos = rate > 0 ? static_cast<std::int64_t>(udp_bridge::kNanos / double{rate}) : 0;
    expires_nanos.reset();
    if (request.lease_s) expires_nanos = now_nanos + request.lease_s * udp_bridge::kNanos;
  }
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_LEASE_HPP
