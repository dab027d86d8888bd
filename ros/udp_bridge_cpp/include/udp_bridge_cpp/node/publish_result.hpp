// SPDX-License-Identifier: Apache-2.0
//
// The outcome of one message, for the reports to its sender.

#ifndef UDP_BRIDGE_CPP_NODE_PUBLISH_RESULT_HPP
#define UDP_BRIDGE_CPP_NODE_PUBLISH_RESULT_HPP

#include <cstddef>
#include <cstdint>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/io/clock.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_cpp {

/// Whether a message was published, and when that was known.
struct PublishResult {
  Address sender;
  udp_bridge::Header header;
  std::uint64_t count = 0;
  std::size_t size = 0;
  bool is_published = false;
  std::int64_t at_nanos = 0;

  PublishResult(const udp_bridge::Message& message, const Address& from, bool is_taken)
      : sender(from),
        header(message.header),
        count(message.count),
        size(message.body.size()),
        is_published(is_taken),
        at_nanos(steady_nanos()) {}
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_PUBLISH_RESULT_HPP
