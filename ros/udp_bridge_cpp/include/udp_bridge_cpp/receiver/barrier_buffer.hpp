// SPDX-License-Identifier: Apache-2.0
//
// Holds messages of one gateway until a Barrier announces that all of them were sent (lockstep).
//
// Messages are compared with the announced numbers, so loss, copies and reordering change nothing.

#ifndef UDP_BRIDGE_CPP_RECEIVER_BARRIER_BUFFER_HPP
#define UDP_BRIDGE_CPP_RECEIVER_BARRIER_BUFFER_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include "udp_bridge_cpp/wire/barrier.hpp"
#include "udp_bridge_cpp/wire/message.hpp"
#include "udp_bridge_cpp/wire/message_types.hpp"

namespace udp_bridge_cpp {

/// Messages that no Barrier has released yet.
class BarrierBuffer {
 public:
  using Drop = std::function<void(const Received&)>;

  /// `drop` is called with each message that no Barrier will release.
  explicit BarrierBuffer(Drop drop) : drop_(std::move(drop)) {}

  /// Hold a message; a copy is dropped.
  void put(Received&& received) {
    const udp_bridge::Header& header = received.message.header;
    const std::size_t size = received.message.body.size();
    auto& of_topic = held_[{header.msg_type, header.topic}];
    const bool is_full = messages_ >= kMaxMessages || bytes_ + size > kMaxBytes;
    if (is_full || of_topic.count(header.seq_number)) return drop_(received);
    of_topic.emplace(header.seq_number, std::move(received));
    ++messages_;
    bytes_ += size;
  }

  /// Return how many of the announced messages have not arrived.
  std::uint32_t missing(const std::vector<SentMessages>& announced) const {
    std::uint32_t count = 0;
    for (const SentMessages& sent : announced) {
      const auto of_topic = held_.find(sent.key);
      count += sent.messages;
      if (of_topic == held_.end()) continue;
      for (const auto& [number, message] : of_topic->second) {
        count -= sent.offset(number) < sent.messages;
      }
    }
    return count;
  }

  /// Return one held message of each announced topic that has any; nullptr for none.
  std::vector<const Received*> samples(const std::vector<SentMessages>& announced) const {
    std::vector<const Received*> found;
    for (const SentMessages& sent : announced) {
      const auto of_topic = held_.find(sent.key);
      if (of_topic == held_.end() || of_topic->second.empty()) continue;
      found.push_back(&of_topic->second.begin()->second);
    }
    return found;
  }

  /// Return the announced messages that arrived; drop earlier ones of their topics, keep later.
  std::vector<Received> take(const std::vector<SentMessages>& announced) {
    std::vector<Received> taken;
    for (const SentMessages& sent : announced) {
      const auto of_topic = held_.find(sent.key);
      if (of_topic == held_.end()) continue;
      for (auto at = of_topic->second.begin(); at != of_topic->second.end();) {
        const std::uint32_t offset = sent.offset(at->first);
        if (offset >= sent.messages && offset < 1u << 31) {
          ++at;
          continue;
        }
        --messages_;
        bytes_ -= at->second.message.body.size();
        if (offset < sent.messages) {
          taken.push_back(std::move(at->second));
        } else {
          drop_(at->second);
        }
        at = of_topic->second.erase(at);
      }
    }
    return in_order(std::move(taken));
  }

  /// Return all held messages.
  std::vector<Received> take_all() {
    std::vector<Received> taken;
    for (auto& [key, of_topic] : held_) {
      for (auto& [number, received] : of_topic) taken.push_back(std::move(received));
    }
    held_.clear();
    messages_ = bytes_ = 0;
    return in_order(std::move(taken));
  }

  void drop_all() {
    for (const Received& received : take_all()) drop_(received);
  }

 private:
  static constexpr std::size_t kMaxMessages = 65536;
  static constexpr std::size_t kMaxBytes = 512u << 20;

  /// Sort for publication: by stamp, type, topic and number; Clock last of its stamp.
  static std::vector<Received> in_order(std::vector<Received>&& messages) {
    const auto key = [](const Received& received) {
      const udp_bridge::Header& header = received.message.header;
      return std::make_tuple(header.stamp_nanos(), header.msg_type == kClock, header.msg_type,
                             std::cref(header.topic), header.seq_number);
    };
    std::sort(messages.begin(), messages.end(),
              [&](const Received& a, const Received& b) { return key(a) < key(b); });
    return std::move(messages);
  }

  Drop drop_;
  std::map<TopicKey, std::map<std::uint32_t, Received>> held_;
  std::size_t messages_ = 0, bytes_ = 0;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_RECEIVER_BARRIER_BUFFER_HPP
