// SPDX-License-Identifier: Apache-2.0
//
// Requests for lost parts of all offered topics of all senders.

#ifndef UDP_BRIDGE_CPP_RECEIVER_REPAIR_REQUESTS_HPP
#define UDP_BRIDGE_CPP_RECEIVER_REPAIR_REQUESTS_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <tuple>
#include <utility>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/receiver/goodput.hpp"
#include "udp_bridge_cpp/receiver/nack_tracker.hpp"
#include "udp_bridge_cpp/wire/address.hpp"
#include "udp_bridge_cpp/wire/resend_bodies.hpp"

namespace udp_bridge_cpp {

/// Watches the datagrams of offered topics, ahead of the Receiver, and requests what is missing.
class RepairRequests {
 public:
  /// `send` sends a datagram to an address.
  RepairRequests(udp_bridge::Receiver& receiver,
                 std::function<void(Bytes&&, const Address&)> send)
      : receiver_(receiver), send_(std::move(send)) {}

  /// Take an Offer.
  void on_offer(const udp_bridge::Header& header, const Offer& offer, const Address& sender,
                std::int64_t now_nanos) {
    const Key key{sender, offer.msg_type, header.topic};
    if (topics_.size() >= kMaxTopics && !topics_.count(key)) {
      topics_.erase(std::min_element(topics_.begin(), topics_.end(),
                                     [](const auto& a, const auto& b) {
                                       return a.second.used_nanos < b.second.used_nanos;
                                     }));
    }
    const auto [at, is_new] = topics_.try_emplace(key);
    at->second.used_nanos = now_nanos;
    if (is_new) receiver_.offer(sender.id(), offer.msg_type, header.topic, now_nanos);
    NackTracker& tracker = at->second.tracker;
    if (!tracker.is_plausible(header.seq_number, NackTracker::kOffersApart)) return;
    const bool is_received =
        is_new && receiver_.is_finished(sender.id(), offer.msg_type, header);
    follow(key, tracker.on_offer(header, offer, is_received, now_nanos), header.seq_number,
           now_nanos);
    request(key, tracker, now_nanos);
  }

  /// Take a datagram, before the Receiver does; only those of offered topics are parsed.
  void on_datagram(const Bytes& datagram, const Address& sender, std::int64_t now_nanos) {
    if (topics_.empty()) return;
    goodputs_[sender].add(datagram.size(), now_nanos);
    if (goodputs_.size() > kMaxTopics) goodputs_.erase(goodputs_.begin());
    udp_bridge::Header header;
    std::size_t offset = 0;
    const auto refusal =
        udp_bridge::Header::parse(datagram.data(), datagram.size(), header, offset);
    if (refusal != udp_bridge::Refusal::none) return;
    const Key key{sender, header.msg_type, header.topic};
    const auto found = topics_.find(key);
    if (found == topics_.end() || !found->second.tracker.is_plausible(header.seq_number, 1)) return;
    found->second.used_nanos = now_nanos;
    NackTracker& tracker = found->second.tracker;
    follow(key, tracker.on_part(header, now_nanos), header.seq_number, now_nanos);
    request(key, tracker, now_nanos);
  }

 private:
  static constexpr std::size_t kMaxTopics = 128;
  using Key = std::tuple<Address, std::uint8_t, std::string>;

  struct Topic {
    NackTracker tracker;
    std::int64_t used_nanos = 0;
  };

  /// Let the Receiver know what a datagram means.
  void follow(const Key& key, const NackTracker::Arrival& arrival, std::uint32_t number,
              std::int64_t now_nanos) {
    const auto& [sender, msg_type, topic] = key;
    if (arrival.is_restart) receiver_.restart(sender.id(), msg_type, topic, now_nanos);
    if (arrival.is_repaired) receiver_.requested(sender.id(), msg_type, topic, number, now_nanos);
  }

  void request(const Key& key, NackTracker& tracker, std::int64_t now_nanos) {
    const auto& [sender, msg_type, topic] = key;
    for (Nack& nack : tracker.take_due(msg_type, now_nanos)) {
      nack.request.goodput = goodputs_[sender].last_second(now_nanos);
      udp_bridge::Header header;
      header.msg_type = kResend;
      header.seq_number = nack.number;
      header.topic = topic;
      header.set_stamp(nack.stamp_nanos);
      Bytes datagram(header.size());
      header.pack(datagram.data());
      const Bytes body = nack.request.pack();
      datagram.insert(datagram.end(), body.begin(), body.end());
      for (int copy = 0; copy < nack.copies; ++copy) send_(Bytes(datagram), sender);
    }
  }

  udp_bridge::Receiver& receiver_;
  const std::function<void(Bytes&&, const Address&)> send_;
  std::map<Key, Topic> topics_;
  std::map<Address, Goodput> goodputs_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_RECEIVER_REPAIR_REQUESTS_HPP
