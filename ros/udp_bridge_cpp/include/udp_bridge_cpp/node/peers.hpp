// SPDX-License-Identifier: Apache-2.0
//
// All peers that messages are sent to.

#ifndef UDP_BRIDGE_CPP_SENDER_PEERS_HPP
#define UDP_BRIDGE_CPP_SENDER_PEERS_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "udp_bridge_cpp/io/clock.hpp"
#include "udp_bridge_cpp/io/datagram_queue.hpp"
#include "udp_bridge_cpp/sender/peer_sender.hpp"
#include "udp_bridge_cpp/wire/address.hpp"

namespace udp_bridge_cpp {

/// A PeerSender for each address.
class Peers {
 public:
  /// Peers at most; the one that was used least recently is forgotten.
  static constexpr std::size_t kMaxPeers = 64;

  Peers(DatagramQueue& output, std::size_t datagram)
      : output_(output), datagram_(datagram) {}

  /// Return the sender to a peer.
  PeerSender& at(const Address& address) {
    if (peers_.size() >= kMaxPeers && !peers_.count(address)) {
      peers_.erase(std::min_element(peers_.begin(), peers_.end(), [](const auto& a, const auto& b) {
        return a.second.used < b.second.used;
      }));
    }
    Peer& peer = peers_[address];
    if (!peer.sender) {
      peer.sender = std::make_unique<PeerSender>(
          [this, address](Bytes&& datagram) { output_.push({std::move(datagram), address}); },
          datagram_);
    }
    peer.used = ++uses_;
    return *peer.sender;
  }

  /// Return the sender to a peer that was sent something; else nullptr.
  PeerSender* find(const Address& address) {
    const auto found = peers_.find(address);
    return found == peers_.end() ? nullptr : found->second.sender.get();
  }

  /// Send what is due to all peers; return when something else is.
  std::int64_t turn(std::int64_t now_nanos) {
    std::int64_t next = now_nanos + udp_bridge::kNanos;
    for (auto& [address, peer] : peers_) next = std::min(next, peer.sender->turn(now_nanos));
    return next;
  }

  /// Return how many messages of ROS types a peer was sent, by topic.
  std::map<TopicKey, std::uint32_t> counts(const Address& address) {
    auto counts = at(address).counts();
    for (auto row = counts.begin(); row != counts.end();) {
      row = udp_bridge::has_ros_type(row->first.first) ? std::next(row) : counts.erase(row);
    }
    return counts;
  }

  /// Send a Control message.
  void send_control(const Address& to, const std::string& topic, const Bytes& body) {
    at(to).send(udp_bridge::kControl, topic, "", wall_nanos(), body, 0, steady_nanos());
  }

 private:
  struct Peer {
    std::unique_ptr<PeerSender> sender;
    std::uint64_t used = 0;
  };

  DatagramQueue& output_;
  const std::size_t datagram_;
  std::map<Address, Peer> peers_;
  std::uint64_t uses_ = 0;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_SENDER_PEERS_HPP
