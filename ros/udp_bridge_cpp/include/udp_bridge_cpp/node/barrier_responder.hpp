// SPDX-License-Identifier: Apache-2.0
//
// Lockstep at the ROS end: the run's time waits until ROS has its data and has responded.
//
// From its first Barrier on, a gateway's messages are held. A Barrier lists the messages that were
// sent; all of them are then published, in an order that does not depend on the network. A
// BarrierReply follows when ROS has responded as the Barrier requires. With `in_turn`, the next
// message is published after all responses to those before, so nodes with several inputs get them
// in one order; but at once after a message that no node works on, as one that is kept to be
// joined. All of it happens in the processing thread; only the publishing of a batch ends in the
// publishing thread.
//
// Nothing is published before publishers and subscribers are matched: new ones are given some time,
// because DDS does not tell when a match is complete. A node that is started during a run requests
// what was sent before its start; until its first tick is done, missing responses are given up.

#ifndef UDP_BRIDGE_CPP_NODE_BARRIER_RESPONDER_HPP
#define UDP_BRIDGE_CPP_NODE_BARRIER_RESPONDER_HPP

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "udp_bridge_cpp/io/clock.hpp"
#include "udp_bridge_cpp/node/leased_subscriptions.hpp"
#include "udp_bridge_cpp/node/peers.hpp"
#include "udp_bridge_cpp/node/publish_queue.hpp"
#include "udp_bridge_cpp/node/response_tracker.hpp"
#include "udp_bridge_cpp/receiver/barrier_buffer.hpp"
#include "udp_bridge_cpp/sender/announced_counts.hpp"
#include "udp_bridge_cpp/wire/barrier.hpp"
#include "udp_bridge_cpp/wire/message.hpp"
#include "udp_bridge_cpp/wire/message_types.hpp"

namespace udp_bridge_cpp {

/// Responds to the Barriers of all gateways.
class BarrierResponder {
 public:
  using Drop = std::function<void(const Received&)>;

  /// `drop` is called with each message that will not be published; `wake` from any thread when
  /// `turn` has something to do; `take` from any thread with responses that nobody has subscribed
  /// to, for `received`.
  BarrierResponder(Ros& ros, PublishQueue& queue, LeasedSubscriptions& leases, Peers& peers,
                   Drop drop, std::function<void()> wake, std::function<void(TopicSample&&)> take)
      : ros_(ros),
        queue_(queue),
        leases_(leases),
        peers_(peers),
        drop_(std::move(drop)),
        wake_(std::move(wake)),
        responses_(ros, std::move(take)) {}

  /// Note a message of ROS on a topic.
  void received(const std::string& topic, ResponseLedger::Stamp stamp_nanos) {
    responses_.received(topic, stamp_nanos);
  }

  /// Return whether messages of a sender are held on a topic.
  bool holds(const Received& received) const {
    if (!gateways_.count(received.sender)) return false;
    const udp_bridge::Header& header = received.message.header;
    const MessageType& row = *message_type(header.msg_type);
    return !publisher_qos(row, header.topic, row.ros_type).is_repeated;
  }

  /// Hold a message of a gateway in lockstep.
  void hold(Received&& received) {
    const Address sender = received.sender;
    Gateway& gateway = gateways_.at(sender);
    gateway.buffer.put(std::move(received));
    if (gateway.barrier && !gateway.reply && !gateway.is_queued()) {
      publish_if_complete(gateway);
    }
  }

  /// Process a Barrier or a repeated one.
  void take(Barrier&& barrier, const Address& sender) {
    const std::int64_t now_nanos = steady_nanos();
    if (!gateways_.count(sender) && !admit(barrier, sender, now_nanos)) return;
    Gateway& gateway = gateways_.at(sender);
    gateway.barrier_nanos = now_nanos;
    if (gateway.was_sent_before_start(barrier)) {
      const BarrierReply reply{barrier.episode, barrier.tick, BarrierReply::restarted, 0, {}};
      peers_.send_control(sender, "", reply.pack());
      return;
    }
    if (!gateway.barrier) gateway.announced.mark_announced(peers_.counts(sender));
    if (!gateway.barrier || gateway.barrier->episode != barrier.episode ||
        gateway.barrier->tick != barrier.tick) {
      if (barrier.tick < 0) gateway.buffer.drop_all();
      gateway.take(std::move(barrier), now_nanos);
      responses_.expect(gateway.barrier->responses);
      publish_if_complete(gateway);
      if (gateway.is_queued()) return;
    }
    send_reply(sender, gateway);
  }

  /// Publish what can be delivered now, and reply where all responses are there; return whether
  /// there is a Barrier without its reply.
  bool turn(std::int64_t now_nanos) {
    bool is_waiting = false;
    for (auto at = gateways_.begin(); at != gateways_.end();) {
      auto& [sender, gateway] = *at++;
      if (now_nanos - gateway.barrier_nanos > kLeaseNanos) {
        end(Address(sender));
      } else if (gateway.barrier && !gateway.reply) {
        is_waiting = true;
        prepare(sender, gateway, now_nanos);
        if (gateway.published_nanos()) reply_if_done(sender, gateway, now_nanos);
        warn(gateway, now_nanos);
      }
    }
    return is_waiting;
  }

 private:
  static constexpr std::int64_t kNanos = udp_bridge::kNanos;
  static constexpr std::int64_t kSettleNanos = kNanos;      // for a new publisher to be matched
  static constexpr std::int64_t kLeaseNanos = 10 * kNanos;  // a gateway sends a Barrier each second
  static constexpr std::int64_t kGiveUpNanos = 10 * kNanos;
  static constexpr std::int64_t kWarnNanos = 3 * kNanos;
  static constexpr std::size_t kMaxGateways = 4;
  static constexpr std::int64_t kSilentNanos = 3 * kNanos;

  /// One gateway in lockstep: its held messages and the progress of its Barrier.
  struct Gateway {
    explicit Gateway(Drop drop) : buffer(std::move(drop)) {}

    BarrierBuffer buffer;
    AnnouncedCounts announced;  // of what ROS sent
    std::optional<Barrier> barrier;
    std::optional<BarrierReply> reply;
    std::int64_t begun_nanos = 0, barrier_nanos = 0;
    std::vector<SentMessages> sent_before_start;  // of the first Barrier
    bool may_lack_responses = false;  // some may have gone to a process that ran before
    bool needs_responses = false;     // the Barrier requires responses that were not given up
    bool is_first_of_episode = false;
    bool has_warned = false;
    std::uint32_t lost = 0;
    std::optional<std::uint64_t> episode;
    /// Messages to publish after the responses to those before.
    std::deque<Received> waiting;
    /// When the last queued batch was published, 0 until then; none while nothing was queued.
    std::shared_ptr<std::atomic<std::int64_t>> published;

    bool is_queued() const { return published != nullptr; }
    std::int64_t published_nanos() const { return published ? published->load() : 0; }

    /// Begin a new Barrier.
    void take(Barrier&& next, std::int64_t now_nanos) {
      if (next.tick >= 0 && (!barrier || barrier->tick < 0)) {
        may_lack_responses = next.tick > 0 || !sent_before_start.empty();
      }
      is_first_of_episode = next.tick == 0 || (episode && *episode != next.episode);
      if (next.tick >= 0) episode = next.episode;
      barrier = std::move(next);
      begun_nanos = now_nanos;
      waiting.clear();
      published.reset();
      reply.reset();
      has_warned = false;
      lost = 0;
    }

    /// Return whether the messages of a Barrier were sent before this node started.
    bool was_sent_before_start(const Barrier& first) {
      if (!barrier && sent_before_start.empty()) sent_before_start = first.sent;
      return !barrier && !first.sent.empty() && first.sent == sent_before_start;
    }

    std::set<std::string> sent_topics() const {
      std::set<std::string> topics;
      for (const SentMessages& sent : barrier->sent) topics.insert(sent.key.second);
      return topics;
    }
  };

  /// Begin lockstep with a gateway; return false where there is no room.
  bool admit(const Barrier& barrier, const Address& sender, std::int64_t now_nanos) {
    if (gateways_.size() >= kMaxGateways) {
      const auto silent = std::min_element(
          gateways_.begin(), gateways_.end(), [](const auto& a, const auto& b) {
            return a.second.barrier_nanos < b.second.barrier_nanos;
          });
      if (now_nanos - silent->second.barrier_nanos < kSilentNanos) return false;
      end(Address(silent->first));
    }
    gateways_.try_emplace(sender, drop_);
    settled_nanos_ = now_nanos + kSettleNanos;
    std::string waits_for;
    for (const ExpectedResponse& response : barrier.responses) {
      waits_for += (waits_for.empty() ? "" : ", ") + response.topic + " to " + response.of;
    }
    ros_.info("in lockstep with " + sender.text() + ": time waits for " +
              (waits_for.empty() ? "nothing" : waits_for));
    return true;
  }

  /// Queue all messages if they are complete and can be delivered; else `turn` will.
  void publish_if_complete(Gateway& gateway) {
    const Barrier& barrier = *gateway.barrier;
    const std::uint32_t missing = gateway.buffer.missing(barrier.sent);
    const std::int64_t limit_nanos = std::int64_t{barrier.limit_ms} * 1000000;
    if (missing && steady_nanos() - gateway.begun_nanos < limit_nanos) return;
    if (!barrier.sent.empty() && !is_matched(gateway)) return;
    gateway.lost = missing;
    gateway.needs_responses = false;
    for (Received& received : gateway.buffer.take(barrier.sent)) {
      gateway.waiting.push_back(std::move(received));
    }
    publish_batch(gateway);
  }

  /// Publish the next messages, with `in_turn` until the first that a node works on.
  void publish_batch(Gateway& gateway) {
    report_surplus(*gateway.barrier);
    std::vector<Received> messages;
    bool is_worked_on = false;
    while (!gateway.waiting.empty() && !(is_worked_on && gateway.barrier->in_turn)) {
      messages.push_back(std::move(gateway.waiting.front()));
      gateway.waiting.pop_front();
      const udp_bridge::Header& header = messages.back().message.header;
      // The first Clock of an episode needs no response: a ROS timer begins to count at it.
      if (gateway.is_first_of_episode && header.msg_type == kClock) continue;
      is_worked_on = responses_.published(header.topic, header.stamp_nanos());
    }
    gateway.needs_responses |= !responses_.due_topic().empty();
    gateway.published = std::make_shared<std::atomic<std::int64_t>>(0);
    queue_.put_all(std::move(messages), [published = gateway.published, wake = wake_] {
      published->store(steady_nanos());
      wake();
    });
  }

  /// Log the first messages of a topic that nothing caused, and forget them.
  void report_surplus(const Barrier& barrier) {
    for (const auto& [topic, count] : responses_.settle()) {
      if (!barrier.in_turn || !topics_with_surplus_.insert(topic).second) continue;
      ros_.warn("lockstep: tick " + std::to_string(barrier.tick) + ": " + std::to_string(count) +
                " messages on " + topic +
                " more than what its node consumed; results are not reproducible");
    }
  }

  bool is_matched(const Gateway& gateway) const {
    if (steady_nanos() < settled_nanos_) return false;
    std::set<std::string> topics;
    for (const Received* sample : gateway.buffer.samples(gateway.barrier->sent)) {
      topics.insert(sample->message.header.topic);
    }
    return std::all_of(topics.begin(), topics.end(),
                       [&](const std::string& topic) { return queue_.publishes(topic); }) &&
           responses_.unmatched_topic(topics).empty();
  }

  /// Create publishers and subscriptions until the messages can be delivered.
  void prepare(const Address& sender, Gateway& gateway, std::int64_t now_nanos) {
    leases_.keep_for(std::int64_t{gateway.barrier->limit_ms} * 1000000);
    if (gateway.is_queued()) return;
    for (const Received* sample : gateway.buffer.samples(gateway.barrier->sent)) {
      if (queue_.prepare(sample->message, sender)) settled_nanos_ = now_nanos + kSettleNanos;
    }
    if (responses_.update(gateway.sent_topics(), leases_.topics())) {
      settled_nanos_ = now_nanos + kSettleNanos;
    }
    publish_if_complete(gateway);
  }

  void reply_if_done(const Address& sender, Gateway& gateway, std::int64_t now_nanos) {
    const Barrier& barrier = *gateway.barrier;
    if (now_nanos - gateway.begun_nanos > kWarnNanos) responses_.forgive_absent(now_nanos);
    give_up(gateway, now_nanos);
    if (!responses_.due_topic().empty()) return;
    if (!gateway.waiting.empty()) {
      publish_batch(gateway);
      if (!responses_.due_topic().empty() || !gateway.waiting.empty()) return;
      // Nothing else is due: the next Barrier's messages are published behind these anyway.
    }
    report_surplus(barrier);
    if (!peers_.at(sender).is_idle()) return;
    AnnouncedCounts::Counts counts = peers_.counts(sender);
    gateway.reply = BarrierReply{barrier.episode, barrier.tick, BarrierReply::done, gateway.lost,
                                 gateway.announced.unannounced(counts)};
    gateway.announced.mark_announced(std::move(counts));
    gateway.may_lack_responses = gateway.may_lack_responses && !gateway.needs_responses;
    send_reply(sender, gateway);
  }

  /// Continue without responses that may have gone to a process that ran before.
  void give_up(Gateway& gateway, std::int64_t now_nanos) {
    const std::string topic = responses_.due_topic();
    if (topic.empty() || !gateway.may_lack_responses ||
        now_nanos - gateway.published_nanos() <= kGiveUpNanos) {
      return;
    }
    responses_.forgive_all();
    gateway.needs_responses = false;
    ros_.warn("lockstep: tick " + std::to_string(gateway.barrier->tick) +
              " continues without a message on " + topic +
              ", which may have gone to the node that ran before; results are not reproducible");
  }

  /// Send the state of a gateway's Barrier.
  void send_reply(const Address& sender, const Gateway& gateway) {
    if (gateway.reply) return peers_.send_control(sender, "", gateway.reply->pack());
    const std::string topic = waits_for(gateway);
    const BarrierReply reply{gateway.barrier->episode, gateway.barrier->tick,
                             topic.empty() ? BarrierReply::incomplete : BarrierReply::waiting,
                             gateway.lost,
                             {}};
    peers_.send_control(sender, topic, reply.pack());
  }

  std::string waits_for(const Gateway& gateway) const {
    if (gateway.is_queued()) return responses_.due_topic();
    if (gateway.buffer.missing(gateway.barrier->sent)) return {};
    return responses_.unmatched_topic(gateway.sent_topics());
  }

  void warn(Gateway& gateway, std::int64_t now_nanos) {
    if (gateway.has_warned || now_nanos - gateway.begun_nanos < kWarnNanos) return;
    const std::string topic = waits_for(gateway);
    if (topic.empty()) return;
    gateway.has_warned = true;
    ros_.warn("lockstep: tick " + std::to_string(gateway.barrier->tick) + " waits for " +
              (gateway.is_queued() ? "a message" : "a publisher or a subscriber") + " on " + topic);
  }

  void end(const Address& sender) {
    queue_.put_all(gateways_.at(sender).buffer.take_all(), [] {});
    gateways_.erase(sender);
    ros_.info("no longer in lockstep with " + sender.text());
  }

  Ros& ros_;
  PublishQueue& queue_;
  LeasedSubscriptions& leases_;
  Peers& peers_;
  const Drop drop_;
  const std::function<void()> wake_;
  ResponseTracker responses_;
  std::map<Address, Gateway> gateways_;
  std::set<std::string> topics_with_surplus_;  // that were logged
  std::int64_t settled_nanos_ = 0;  // when all known publishers and subscribers will be matched
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_BARRIER_RESPONDER_HPP
