// SPDX-License-Identifier: Apache-2.0
//
// Messages that BarrierReplies have announced to a gateway.

#ifndef UDP_BRIDGE_CPP_SENDER_ANNOUNCED_COUNTS_HPP
#define UDP_BRIDGE_CPP_SENDER_ANNOUNCED_COUNTS_HPP

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "udp_bridge_cpp/wire/barrier.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_cpp {

/// Number of messages of each topic that earlier replies have announced.
class AnnouncedCounts {
 public:
  using Counts = std::map<TopicKey, std::uint32_t>;

  /// Return the ranges to announce; `sent` counts messages since the start.
  std::vector<SentMessages> unannounced(const Counts& sent) const {
    std::vector<SentMessages> rows;
    for (const auto& [key, count] : sent) {
      const auto before = announced_.find(key);
      const std::uint32_t first = before == announced_.end() ? 0 : before->second;
      const std::uint32_t messages = count - first;
      if (messages) rows.push_back({key, first, static_cast<std::uint16_t>(messages)});
    }
    return rows;
  }

  /// Record that all of these were announced, or need not be.
  void mark_announced(Counts sent) { announced_ = std::move(sent); }

 private:
  Counts announced_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_SENDER_ANNOUNCED_COUNTS_HPP
