// SPDX-License-Identifier: Apache-2.0
//
// What the files of the core have in common: bodies, names of topics, whole messages.

#ifndef UDP_BRIDGE_CPP_WIRE_MESSAGE_HPP
#define UDP_BRIDGE_CPP_WIRE_MESSAGE_HPP

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/wire/address.hpp"

namespace udp_bridge_cpp {

using Bytes = std::vector<std::uint8_t>;

/// Number of a wire type, and a topic.
using TopicKey = std::pair<std::uint8_t, std::string>;

/// A whole message of a sender.
struct Received {
  udp_bridge::Message message;
  Address sender;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_WIRE_MESSAGE_HPP
