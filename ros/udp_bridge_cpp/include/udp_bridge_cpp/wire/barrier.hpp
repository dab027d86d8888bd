// SPDX-License-Identifier: Apache-2.0
//
// Bodies of Barrier and BarrierReply, PROTOCOL.md, section 6.

#ifndef UDP_BRIDGE_CPP_WIRE_BARRIER_HPP
#define UDP_BRIDGE_CPP_WIRE_BARRIER_HPP

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <set>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_cpp {

/// Messages of one topic that were sent since the last Barrier or BarrierReply.
struct SentMessages {
  TopicKey key;
  std::uint32_t first = 0;
  std::uint16_t messages = 0;

  bool operator==(const SentMessages& o) const {
    return key == o.key && first == o.first && messages == o.messages;
  }
  /// Return the index of a number in the range; outside it is `messages` or more.
  std::uint32_t offset(std::uint32_t number) const { return number - first; }
};

/// A topic on which a message is due for messages of another topic.
struct ExpectedResponse {
  /// Value of `every`: all responses of one topic with it together mean one response for each stamp
  /// that every topic which causes them has.
  static constexpr std::uint8_t kJoined = 255;

  std::uint8_t msg_type = 0;  ///< of the responses; 0 is any type, of which nothing is sent back
  std::uint8_t every = 0;     ///< 0 or 1: for each message; n: for every n-th message; or kJoined
  std::string topic;
  std::string of;  ///< the topic that causes the responses

  bool operator==(const ExpectedResponse& o) const { return key() == o.key(); }
  bool operator<(const ExpectedResponse& o) const { return key() < o.key(); }

 private:
  std::tuple<const std::string&, const std::string&, std::uint8_t, std::uint8_t> key() const {
    return {topic, of, msg_type, every};
  }
};

/// Announces that all messages up to a tick were sent; no more are sent until ROS is done.
struct Barrier {
  static constexpr std::uint8_t kKind = 4;

  std::uint64_t episode = 0;
  std::int64_t tick = 0;
  std::uint32_t limit_ms = 0;
  bool in_turn = false;  ///< each message that causes responses waits for those to the ones before
  std::vector<SentMessages> sent;
  std::vector<ExpectedResponse> responses;

  static udp_bridge::Refusal parse(const std::uint8_t* body, std::size_t size, Barrier& to) {
    using udp_bridge::Refusal;
    if (size < 24) return Refusal::body_size;
    to.in_turn = body[3] != 0;
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
      if (!sent.messages || !udp_bridge::has_ros_type(row[0]) || !is_new) {
        return Refusal::body_value;
      }
    }
    for (int i = 0; i < body[2]; ++i) {
      if (size - at < 4) return Refusal::body_size;
      const std::uint8_t* row = body + at;
      ExpectedResponse& response = to.responses.emplace_back();
      response.msg_type = row[0];
      response.every = row[3];
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
  static constexpr std::uint8_t kKind = 5;
  enum State : std::uint8_t { done, waiting, incomplete, restarted };

  std::uint64_t episode = 0;
  std::int64_t tick = 0;
  State state = done;
  std::uint32_t lost = 0;
  std::vector<SentMessages> sent;

  Bytes pack() const {
    Bytes body(24);
    body[0] = kKind;
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

#endif  // UDP_BRIDGE_CPP_WIRE_BARRIER_HPP
