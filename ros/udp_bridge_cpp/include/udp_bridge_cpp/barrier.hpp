// SPDX-License-Identifier: Apache-2.0
//
// Bodies of Barrier and BarrierReply, PROTOCOL.md, section 6.

#ifndef UDP_BRIDGE_CPP_BARRIER_HPP
#define UDP_BRIDGE_CPP_BARRIER_HPP

#include <cstdint>
#include <cstring>
#include <set>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "ros.hpp"
#include "udp_bridge.hpp"

namespace udp_bridge_cpp {

using TopicKey = std::pair<std::uint8_t, std::string>;

/// Messages of one topic that were sent since the last Barrier or BarrierReply.
struct SentMessages {
  TopicKey key;
  std::uint32_t first = 0;
  std::uint16_t messages = 0;

  bool operator==(const SentMessages& o) const {
    return key == o.key && first == o.first && messages == o.messages;
  }
  /// Return a number's place in the range; beyond `messages` it is outside.
  std::uint32_t offset(std::uint32_t number) const { return number - first; }
};

/// A topic on which a message is due for each message of another topic.
struct ExpectedResponse {
  std::uint8_t msg_type = 0;  ///< of the responses; 0 is any type, of which nothing is sent back
  std::string topic, of;

  bool operator==(const ExpectedResponse& o) const {
    return msg_type == o.msg_type && topic == o.topic && of == o.of;
  }
  bool operator<(const ExpectedResponse& o) const {
    return std::tie(topic, of, msg_type) < std::tie(o.topic, o.of, o.msg_type);
  }
};

/// All up to a tick was sent, and nothing more is until ROS is done.
struct Barrier {
  static constexpr std::uint8_t kKind = 4;

  std::uint64_t episode = 0;
  std::int64_t tick = 0;
  std::uint32_t limit_ms = 0;
  std::vector<SentMessages> sent;
  std::vector<ExpectedResponse> responses;

  static udp_bridge::Refusal parse(const std::uint8_t* body, std::size_t size, Barrier& to) {
    using udp_bridge::Refusal;
    if (size < 24) return Refusal::body_size;
    to.limit_ms = udp_bridge::detail::read_u32(body + 4);
    to.episode = udp_bridge::detail::read_u64(body + 8);
    to.tick = static_cast<std::int64_t>(udp_bridge::detail::read_u64(body + 16));
    std::size_t at = 24;
    std::set<TopicKey> known;
    for (int i = 0; i < body[1]; ++i) {
      if (size - at < 8) return Refusal::body_size;
      const std::uint8_t* row = body + at;
      SentMessages& sent = to.sent.emplace_back();
      sent.messages = static_cast<std::uint16_t>(row[2] | row[3] << 8);
      sent.first = udp_bridge::detail::read_u32(row + 4);
      at += 8;
      if (const Refusal refusal = name(body, size, at, row[1], sent.key.second);
          refusal != Refusal::none) {
        return refusal;
      }
      sent.key.first = row[0];
      const bool is_new = known.insert(sent.key).second;
      if (!sent.messages || !udp_bridge::has_ros_type(row[0]) || !is_new) return Refusal::body_value;
    }
    for (int i = 0; i < body[2]; ++i) {
      if (size - at < 4) return Refusal::body_size;
      const std::uint8_t* row = body + at;
      ExpectedResponse& response = to.responses.emplace_back();
      response.msg_type = row[0];
      at += 4;
      for (auto [length, text] : {std::pair(row[1], &response.topic), {row[2], &response.of}}) {
        if (const Refusal refusal = name(body, size, at, length, *text); refusal != Refusal::none) {
          return refusal;
        }
      }
      if (row[0] && !udp_bridge::has_ros_type(row[0])) return Refusal::body_value;
    }
    if (at != size) return Refusal::body_size;
    return to.tick < -1 ? Refusal::body_value : Refusal::none;
  }

 private:
  static udp_bridge::Refusal name(const std::uint8_t* body, std::size_t size, std::size_t& at,
                                  std::size_t length, std::string& to) {
    if (size - at < length) return udp_bridge::Refusal::body_size;
    const std::uint8_t* begin = body + at;
    at += length;
    to.assign(begin, begin + length);
    const bool is_name = length && udp_bridge::detail::is_utf8(begin, length) &&
                         !std::memchr(begin, 0, length);
    return is_name ? udp_bridge::Refusal::none : udp_bridge::Refusal::body_value;
  }
};

/// The progress of ROS with a Barrier.
struct BarrierReply {
  enum State : std::uint8_t { done, waiting, incomplete, restarted };

  std::uint64_t episode = 0;
  std::int64_t tick = 0;
  State state = done;
  std::uint32_t lost = 0;
  std::vector<SentMessages> sent;

  Bytes pack() const {
    Bytes body(24);
    body[0] = 5;
    body[1] = static_cast<std::uint8_t>(sent.size());
    body[2] = state;
    udp_bridge::detail::write_u32(body.data() + 4, lost);
    udp_bridge::detail::write_u64(body.data() + 8, episode);
    udp_bridge::detail::write_u64(body.data() + 16, static_cast<std::uint64_t>(tick));
    for (const SentMessages& row : sent) {
      const std::string& topic = row.key.second;
      Bytes fixed = {row.key.first, static_cast<std::uint8_t>(topic.size()),
                     static_cast<std::uint8_t>(row.messages),
                     static_cast<std::uint8_t>(row.messages >> 8), 0, 0, 0, 0};
      udp_bridge::detail::write_u32(fixed.data() + 4, row.first);
      body.insert(body.end(), fixed.begin(), fixed.end());
      body.insert(body.end(), topic.begin(), topic.end());
    }
    return body;
  }
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_BARRIER_HPP
