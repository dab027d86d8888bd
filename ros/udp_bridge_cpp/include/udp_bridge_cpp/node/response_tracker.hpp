// SPDX-License-Identifier: Apache-2.0
//
// Responses that lockstep expects of ROS, and the publishers and subscribers that give them.
//
// ResponseLedger counts them. A responder that has left the graph is excused: what was published
// before its return never reached it.

#ifndef UDP_BRIDGE_CPP_NODE_RESPONSE_TRACKER_HPP
#define UDP_BRIDGE_CPP_NODE_RESPONSE_TRACKER_HPP

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "udp_bridge_cpp/node/response_ledger.hpp"
#include "udp_bridge_cpp/node/ros.hpp"
#include "udp_bridge_cpp/node/ros_sample.hpp"
#include "udp_bridge_cpp/wire/barrier.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_cpp {

/// Counts due responses of the present Barriers, and watches the responders.
class ResponseTracker {
 public:
  /// `take` is called from any thread with each response that is not sent back; its body is empty.
  ResponseTracker(Ros& ros, std::function<void(TopicSample&&)> take)
      : ros_(ros), take_(std::move(take)) {}

  /// Set the expected responses; if they change, nothing is due any more.
  void expect(const std::vector<ExpectedResponse>& expected) {
    if (expected == expected_) return;
    expected_ = expected;
    ledger_ = ResponseLedger(expected);
  }

  /// Count a message before it is published; return whether a node works on it.
  bool published(const std::string& topic, std::int64_t stamp_nanos) {
    return ledger_.published(topic, stamp_nanos);
  }

  /// Note a message of ROS.
  void received(const std::string& topic, ResponseLedger::Stamp stamp_nanos) {
    ledger_.received(topic, stamp_nanos);
  }

  /// Return a topic on which a response is due; empty when none is.
  std::string due_topic() const { return ledger_.owing(); }

  /// Return topics with the number of messages that nothing caused, and forget these.
  std::vector<std::pair<std::string, std::int64_t>> settle() { return ledger_.settle(); }

  /// Expect no response of publishers that have left.
  void forgive_absent(std::int64_t now_nanos) {
    if (now_nanos - checked_nanos_ < kCheckNanos) return;
    checked_nanos_ = now_nanos;
    for (const std::string& topic : topics()) {
      const std::set<std::string> now = ros_.publishers(topic);
      std::set<std::string>& before = publishers_[topic];
      const bool has_left = !std::includes(now.begin(), now.end(), before.begin(), before.end());
      if (now.empty() || has_left) ledger_.forgive(topic);
      before = now;
    }
  }

  /// Expect no response to what has been published.
  void forgive_all() {
    for (const std::string& topic : topics()) ledger_.forgive(topic);
  }

  /// Return a topic without the publisher or subscriber that has to respond; else empty.
  std::string unmatched_topic(const std::set<std::string>& published) const {
    const std::set<std::string> causes = ledger_.caused(published);
    for (const ExpectedResponse& response : expected_) {
      if (!causes.count(response.of)) continue;
      if (!has_responder(response)) return response.topic;
      if (!has_consumer(response)) return response.of;
    }
    return {};
  }

  /// Subscribe to responses; return whether an endpoint is new since the last update.
  bool update(const std::set<std::string>& published, const std::set<TopicKey>& subscribed) {
    const std::set<std::string> causes = ledger_.caused(published);
    for (const ExpectedResponse& response : expected_) {
      const bool is_leased =
          response.msg_type && subscribed.count({response.msg_type, response.topic});
      if (response.msg_type && !is_leased) subscriptions_.erase(response.topic);
      if (!causes.count(response.of) || subscriptions_.count(response.topic)) continue;
      if (is_leased) {
        subscriptions_[response.topic] = nullptr;  // a leased subscription
      } else if (!response.msg_type) {
        if (auto kept = listen(response.topic)) subscriptions_[response.topic] = std::move(kept);
      }
      publishers_[response.topic] = ros_.publishers(response.topic);
    }
    std::set<std::string> matched;
    for (const ExpectedResponse& response : expected_) {
      if (has_responder(response)) matched.insert(response.topic);
      if (has_consumer(response)) matched.insert(response.of);
    }
    const bool is_new =
        !std::includes(matched_.begin(), matched_.end(), matched.begin(), matched.end());
    matched_ = std::move(matched);
    return is_new;
  }

 private:
  static constexpr std::int64_t kCheckNanos = udp_bridge::kNanos / 2;

  std::set<std::string> topics() const {
    std::set<std::string> topics;
    for (const ExpectedResponse& response : expected_) topics.insert(response.topic);
    return topics;
  }

  std::unique_ptr<Subscription> listen(const std::string& topic) {
    return ros_.listen(topic, [this, topic](RosMessage&& message) {
      std::optional<RosSample> sample = RosSample::of(std::move(message));
      take_({{0, topic}, {{}, sample ? sample->stamp_nanos : std::nullopt, {}}});
    });
  }

  bool has_responder(const ExpectedResponse& response) const {
    return subscriptions_.count(response.topic) && ros_.has_publisher(response.topic);
  }

  bool has_consumer(const ExpectedResponse& response) const {
    return ros_.has_subscriber(response.of, subscriptions_.count(response.of) > 0);
  }

  Ros& ros_;
  const std::function<void(TopicSample&&)> take_;
  std::vector<ExpectedResponse> expected_;
  ResponseLedger ledger_;
  std::map<std::string, std::unique_ptr<Subscription>> subscriptions_;
  std::map<std::string, std::set<std::string>> publishers_;
  std::set<std::string> matched_;
  std::int64_t checked_nanos_ = 0;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_RESPONSE_TRACKER_HPP
