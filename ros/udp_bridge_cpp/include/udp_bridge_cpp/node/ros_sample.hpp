// SPDX-License-Identifier: Apache-2.0
//
// A message of ROS with the fields that a datagram's header needs.

#ifndef UDP_BRIDGE_CPP_NODE_ROS_SAMPLE_HPP
#define UDP_BRIDGE_CPP_NODE_ROS_SAMPLE_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/node/ros.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_cpp {

/// A message of ROS.
struct RosSample {
  std::string frame;
  std::optional<std::int64_t> stamp_nanos;  ///< none: the message gets the time of sending
  Bytes body;

  /// Return a message of ROS as a sample; none where it is too short for its std_msgs/Header.
  static std::optional<RosSample> of(RosMessage&& message) {
    constexpr std::size_t kHeaderEnd = 16;  // encapsulation, sec, nanosec, size of the frame
    const Bytes& cdr = message.cdr;
    RosSample sample;
    if (message.is_stamped) {
      if (cdr.size() < kHeaderEnd) return std::nullopt;
      const auto sec = static_cast<std::int32_t>(udp_bridge::detail::read_u32(cdr.data() + 4));
      const std::uint32_t nanosec = udp_bridge::detail::read_u32(cdr.data() + 8);
      const std::size_t size = udp_bridge::detail::read_u32(cdr.data() + 12);  // with its NUL
      const std::size_t letters = std::min(size ? size - 1 : 0, cdr.size() - kHeaderEnd);
      const auto* frame = reinterpret_cast<const char*>(cdr.data() + kHeaderEnd);
      sample.frame.assign(frame, letters);
      sample.stamp_nanos = sec * udp_bridge::kNanos + nanosec;
    }
    sample.body = std::move(message.cdr);
    return sample;
  }
};

/// A sample on its way from a callback of ROS to the processing thread.
struct TopicSample {
  TopicKey key;  ///< its type is 0 where the sample only counts as a response
  RosSample sample;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_ROS_SAMPLE_HPP
