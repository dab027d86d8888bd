// SPDX-License-Identifier: Apache-2.0
//
// Sends messages to one peer: numbers, parts, pace and repair.

#ifndef UDP_BRIDGE_CPP_SENDER_PEER_SENDER_HPP
#define UDP_BRIDGE_CPP_SENDER_PEER_SENDER_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/sender/resender.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_cpp {

/// One peer that messages are sent to.
///
/// No Credit is requested: messages of several parts are paced as PROTOCOL.md, section 8, says for
/// a peer without Credits. Messages of one part are sent at once.
class PeerSender {
 public:
  /// `emit` sends a datagram, `datagram` is the largest size or a preset.
  PeerSender(std::function<void(Bytes&&)> emit, std::size_t datagram)
      : emit_(std::move(emit)), datagram_(datagram) {}

  /// Send a message; return false where it can't be sent. With `resend_nanos` above 0 the peer may
  /// request it again for so long.
  bool send(std::uint8_t msg_type, const std::string& topic, const std::string& link,
            std::int64_t stamp_nanos, const Bytes& body, std::int64_t resend_nanos,
            std::int64_t now_nanos) {
    if (waiting_bytes_ > kMaxWaitingBytes) return false;
    std::vector<Bytes> datagrams;
    const bool is_sent = sender_.send(
        msg_type, topic, link, stamp_nanos, body.data(), body.size(),
        msg_type == udp_bridge::kControl ? udp_bridge::kLargestDatagram : datagram_,
        [&](const std::uint8_t* head, std::size_t head_size, const std::uint8_t* part,
            std::size_t part_size) {
          Bytes& bytes = datagrams.emplace_back(head, head + head_size);
          bytes.insert(bytes.end(), part, part + part_size);
        });
    if (!is_sent) return false;
    const bool is_kept = resend_nanos > 0;
    for (Bytes& datagram : datagrams) {
      Bytes sent = is_kept ? datagram : std::move(datagram);
      if (datagrams.size() == 1) {
        emit_(std::move(sent));
      } else {
        waiting_bytes_ += sent.size();
        waiting_.push_back(std::move(sent));
      }
    }
    if (is_kept) {
      const std::uint32_t number = sender_.counts().at({msg_type, topic}) - 1;
      history_.add(msg_type, topic, number, stamp_nanos, std::move(datagrams), resend_nanos,
                   now_nanos);
    }
    turn(now_nanos);
    return true;
  }

  /// Answer a Request of the peer.
  void requested(const udp_bridge::Header& header, const Request& request, std::int64_t now_nanos) {
    history_.requested(header, request, now_nanos, emit_);
  }

  /// Send what is due; return when something else is.
  std::int64_t turn(std::int64_t now_nanos) {
    budget_bytes_ = std::min<double>(
        kBurstBytes, budget_bytes_ + static_cast<double>(now_nanos - turned_nanos_) *
                                         kBytesPerSecond / udp_bridge::kNanos);
    turned_nanos_ = now_nanos;
    while (!waiting_.empty() && budget_bytes_ >= static_cast<double>(waiting_.front().size())) {
      budget_bytes_ -= static_cast<double>(waiting_.front().size());
      waiting_bytes_ -= waiting_.front().size();
      emit_(std::move(waiting_.front()));
      waiting_.pop_front();
    }
    const std::int64_t offered = history_.turn(now_nanos, emit_);
    return waiting_.empty() ? offered : std::min(offered, now_nanos + kPaceNanos);
  }

  /// Whether all parts of all messages were sent.
  bool is_idle() const { return waiting_.empty(); }

  /// The number of messages sent, by msg_type and topic.
  const std::map<TopicKey, std::uint32_t>& counts() const {
    return sender_.counts();
  }

 private:
  static constexpr double kBytesPerSecond = 50e6;
  static constexpr double kBurstBytes = 133120;
  static constexpr std::int64_t kPaceNanos = 1000000;
  static constexpr std::size_t kMaxWaitingBytes = 64u << 20;

  std::function<void(Bytes&&)> emit_;
  const std::size_t datagram_;
  udp_bridge::Sender sender_;
  Resender history_;
  std::deque<Bytes> waiting_;
  std::size_t waiting_bytes_ = 0;
  double budget_bytes_ = kBurstBytes;
  std::int64_t turned_nanos_ = 0;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_SENDER_PEER_SENDER_HPP
