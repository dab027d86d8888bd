// SPDX-License-Identifier: Apache-2.0
//
// From ROS to the bridge: subscriptions that peers request, each with a lease and a rate limit.

#ifndef UDP_BRIDGE_CPP_NODE_LEASED_SUBSCRIPTIONS_HPP
#define UDP_BRIDGE_CPP_NODE_LEASED_SUBSCRIPTIONS_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>

#include "udp_bridge_cpp/io/clock.hpp"
#include "udp_bridge_cpp/node/lease.hpp"
#include "udp_bridge_cpp/node/peers.hpp"
#include "udp_bridge_cpp/node/ros.hpp"
#include "udp_bridge_cpp/node/ros_sample.hpp"
#include "udp_bridge_cpp/wire/message.hpp"
#include "udp_bridge_cpp/wire/message_types.hpp"

namespace udp_bridge_cpp {

/// Subscribes to the topics that peers request, and sends them the messages.
class LeasedSubscriptions {
 public:
  /// Subscriptions, and leases of each, at most: a hostile peer must not fill the ROS graph.
  static constexpr std::size_t kMaxSubscriptions = 64;
  /// A lease that was not renewed for so long may lose its slot.
  static constexpr std::int64_t kIdleNanos = 10 * udp_bridge::kNanos;

  /// `is_published` says whether the bridge publishes a topic; `take` is called from any thread
  /// with each message of ROS, and passes it to `offer` in the processing thread.
  LeasedSubscriptions(Ros& ros, Peers& peers, std::int64_t resend_nanos,
                      std::function<bool(const std::string&)> is_published,
                      std::function<void(TopicSample&&)> take)
      : ros_(ros),
        peers_(peers),
        resend_nanos_(resend_nanos),
        is_published_(std::move(is_published)),
        take_(std::move(take)) {}

  /// Serve the request of a peer; return whether that is possible.
  bool serve(const udp_bridge::Subscribe& request, const std::string& named,
             const Address& sender) {
    const MessageType& row = *message_type(request.wanted_type);
    const TopicKey key{row.number, named.empty() ? std::string(row.default_topic) : named};
    if (!request.wanted) {
      end(key, sender, "unsubscribed");
      return true;
    }
    if (!subscriptions_.count(key)) {
      const std::string complaint = subscribe(row, key, sender);
      if (!complaint.empty()) return complain(key, complaint);
    }
    std::map<Address, Lease>& leases = subscriptions_.at(key).leases;
    if (!leases.count(sender) && leases.size() >= kMaxSubscriptions) {
      const auto oldest = oldest_lease(leases);
      if (steady_nanos() - oldest->second.renewed_nanos < kIdleNanos) return false;
      leases.erase(oldest);
    }
    leases[sender].renew(request, steady_nanos());
    return true;
  }

  /// Send a message of ROS to the peers that hold a lease, each at its rate.
  void offer(TopicSample&& taken) {
    const auto found = subscriptions_.find(taken.key);
    if (found == subscriptions_.end()) return;
    RosSample& sample = taken.sample;
    if (const std::string& ros_type = found->second.ros_type; !ros_type.empty()) {
      sample.body = udp_bridge::Typed::pack(ros_type, sample.body.data(), sample.body.size());
    }
    for (auto& [address, lease] : found->second.leases) {
      lease.held = sample;
      send_due(found->first, address, lease, steady_nanos());
    }
  }

  /// End leases that ran out, and send what was held; return when something else is due.
  std::int64_t turn(std::int64_t now_nanos) {
    std::int64_t next = now_nanos + udp_bridge::kNanos / 10;
    for (auto at = subscriptions_.begin(); at != subscriptions_.end();) {
      auto& [key, subscription] = *at++;
      for (auto lease = subscription.leases.begin(); lease != subscription.leases.end();) {
        auto& [address, held] = *lease++;
        if (held.expires_nanos && now_nanos >= *held.expires_nanos) {
          if (end(TopicKey(key), Address(address), "the lease ran out")) break;
          continue;
        }
        send_due(key, address, held, now_nanos);
        if (held.held) next = std::min(next, held.due_nanos);
      }
    }
    return next;
  }

  /// Let the messages of all topics be requested again for so long, at least.
  void keep_for(std::int64_t nanos) { resend_nanos_ = std::max(resend_nanos_, nanos); }

  /// Topics that are subscribed to.
  std::set<TopicKey> topics() const {
    std::set<TopicKey> keys;
    for (const auto& [key, subscription] : subscriptions_) keys.insert(key);
    return keys;
  }

  /// End all subscriptions.
  void clear() { subscriptions_.clear(); }

  std::uint64_t sent() const { return sent_; }

 private:
  struct Leased {
    std::unique_ptr<Subscription> subscription;
    std::string ros_type;  // of Typed messages; else empty
    std::map<Address, Lease> leases;
  };

  static std::map<Address, Lease>::iterator oldest_lease(std::map<Address, Lease>& leases) {
    return std::min_element(leases.begin(), leases.end(), [](const auto& a, const auto& b) {
      return a.second.renewed_nanos < b.second.renewed_nanos;
    });
  }

  /// Subscribe; return the reason of a failure, or an empty text.
  std::string subscribe(const MessageType& row, const TopicKey& key, const Address& sender) {
    if (is_published_(key.second)) return std::string(row.name) + " comes from the bridge itself";
    if (subscriptions_.size() >= kMaxSubscriptions && !has_freed_slot()) {
      return "there are " + std::to_string(kMaxSubscriptions) + " subscriptions, which is the most";
    }
    std::string ros_type(row.ros_type);
    const bool is_typed = row.number == udp_bridge::kTyped;
    Leased leased;
    try {
      if (is_typed) {
        ros_type = ros_.type_of(key.second);
        if (ros_type.empty()) return "no publisher, so its type is not known yet";
        leased.ros_type = ros_type;
      }
      leased.subscription = ros_.subscribe(
          ros_type, key.second, row,
          [take = take_, key](RosMessage&& message) {
            if (auto sample = RosSample::of(std::move(message))) take({key, std::move(*sample)});
          });
    } catch (const std::exception& error) {
      return error.what();
    }
    subscriptions_.emplace(key, std::move(leased));
    ros_.info(key.second + ": " + ros_type + " subscribed to for " + sender.text());
    return {};
  }

  bool complain(const TopicKey& key, const std::string& complaint) {
    std::string& known = complaints_[key];
    if (known != complaint) ros_.warn(key.second + ": not subscribed to: " + complaint);
    known = complaint;
    if (complaints_.size() > kMaxSubscriptions) complaints_.erase(complaints_.begin());
    return false;
  }

  /// End the subscription that was not renewed for longest; return whether one may end.
  bool has_freed_slot() {
    const auto renewed = [](const auto& entry) {
      std::int64_t newest = 0;
      for (const auto& [address, lease] : entry.second.leases) {
        newest = std::max(newest, lease.renewed_nanos);
      }
      return newest;
    };
    const auto oldest = std::min_element(
        subscriptions_.begin(), subscriptions_.end(),
        [&](const auto& a, const auto& b) { return renewed(a) < renewed(b); });
    if (steady_nanos() - renewed(*oldest) < kIdleNanos) return false;
    ros_.info(oldest->first.second + ": no longer subscribed to: replaced by another subscription");
    subscriptions_.erase(oldest);
    return true;
  }

  /// End a lease; return whether its subscription ended with it.
  bool end(const TopicKey& key, const Address& sender, const std::string& why) {
    const auto found = subscriptions_.find(key);
    if (found == subscriptions_.end() || !found->second.leases.erase(sender)) return false;
    if (!found->second.leases.empty()) return false;
    subscriptions_.erase(found);
    ros_.info(key.second + ": no longer subscribed to: " + why);
    return true;
  }

  void send_due(const TopicKey& key, const Address& to, Lease& lease, std::int64_t now_nanos) {
    if (!lease.held || now_nanos < lease.due_nanos) return;
    const RosSample sample = std::move(*lease.held);
    lease.held.reset();
    lease.due_nanos = now_nanos + lease.period_nanos;
    const std::int64_t stamp_nanos = sample.stamp_nanos ? *sample.stamp_nanos : ros_.now_nanos();
    if (peers_.at(to).send(key.first, key.second, sample.frame, stamp_nanos, sample.body,
                           resend_nanos_, now_nanos)) {
      ++sent_;
    } else {
      complain(key, "a message can't be sent");
    }
  }

  Ros& ros_;
  Peers& peers_;
  std::int64_t resend_nanos_;
  const std::function<bool(const std::string&)> is_published_;
  const std::function<void(TopicSample&&)> take_;
  std::map<TopicKey, Leased> subscriptions_;
  std::map<TopicKey, std::string> complaints_;
  std::uint64_t sent_ = 0;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_LEASED_SUBSCRIPTIONS_HPP
