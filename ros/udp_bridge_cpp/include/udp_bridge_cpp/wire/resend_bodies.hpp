// SPDX-License-Identifier: Apache-2.0
//
// Bodies of Resend (type 65), PROTOCOL.md, section 9.2.

#ifndef UDP_BRIDGE_CPP_WIRE_RESEND_BODIES_HPP
#define UDP_BRIDGE_CPP_WIRE_RESEND_BODIES_HPP

#include <bitset>
#include <cstddef>
#include <cstdint>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_cpp {

constexpr std::uint8_t kResend = 65;
constexpr std::size_t kMaxWholeMessages = 64;

using Parts = std::bitset<256>;

/// Kind 0: all parts of the message that the header names were sent.
struct Offer {
  std::uint8_t msg_type = 0;
  std::uint8_t parts_max = 0;
  std::uint32_t limit_ms = 0;  ///< greatest age of a message that may be requested

  Bytes pack() const {
    Bytes body = {0, msg_type, parts_max, 0, 0, 0, 0, 0};
    udp_bridge::detail::write_u32(body.data() + 4, limit_ms);
    return body;
  }
};

/// Kind 1: these parts of the message that the header names are missing; or, with parts_max 0, so
/// many whole messages from its seq_number on.
struct Request {
  std::uint8_t msg_type = 0;
  std::uint8_t parts_max = 0;
  std::uint8_t messages = 1;
  std::uint32_t goodput = 0;  ///< bytes that arrived from this sender within the last second
  Parts parts;

  Bytes pack() const {
    Bytes body(8 + (parts_max + 7u) / 8);
    body[0] = 1;
    body[1] = msg_type;
    body[2] = parts_max;
    body[3] = messages;
    udp_bridge::detail::write_u32(body.data() + 4, goodput);
    for (std::size_t part = 0; part < parts_max; ++part) {
      if (parts.test(part)) body[8 + part / 8] |= static_cast<std::uint8_t>(1u << part % 8);
    }
    return body;
  }
};

/// A parsed body, whichever kind it is.
struct ResendBody {
  bool is_request = false;
  Offer offer;
  Request request;

  static udp_bridge::Refusal parse(const std::uint8_t* body, std::size_t size, ResendBody& to) {
    using udp_bridge::Refusal;
    if (size < 8) return Refusal::body_size;
    const std::uint8_t parts_max = body[2];
    if (body[0] > 1 || !udp_bridge::has_ros_type(body[1])) return Refusal::body_value;
    to.is_request = body[0] == 1;
    if (size != 8 + (to.is_request ? (parts_max + 7u) / 8 : 0)) return Refusal::body_size;
    const std::uint32_t number = udp_bridge::detail::read_u32(body + 4);
    if (!to.is_request) {
      to.offer = {body[1], parts_max, number};
      return parts_max ? Refusal::none : Refusal::body_value;
    }
    to.request = {body[1], parts_max, body[3], number, {}};
    for (std::size_t bit = 0; bit < 8 * (size - 8); ++bit) {
      if (!(body[8 + bit / 8] >> bit % 8 & 1)) continue;
      if (bit >= parts_max) return Refusal::body_value;
      to.request.parts.set(bit);
    }
    const std::size_t most = parts_max ? 1 : kMaxWholeMessages;
    const bool is_counted = body[3] >= 1 && body[3] <= most;
    return is_counted && to.request.parts.any() == (parts_max != 0) ? Refusal::none
                                                                     : Refusal::body_value;
  }
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_WIRE_RESEND_BODIES_HPP
