// SPDX-License-Identifier: Apache-2.0
//
// Responses that lockstep expects of ROS, counted topic by topic.
//
// For each published message of one topic, a message on another topic is due. Which message responds
// to which is not checked. A responder that has left the graph is excused: what was published before
// its return never reached it.

#ifndef UDP_BRIDGE_CPP_RESPONSE_TRACKER_HPP
#define UDP_BRIDGE_CPP_RESPONSE_TRACKER_HPP

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "barrier.hpp"
#include "ros.hpp"

namespace udp_bridge_cpp {

/// Counts due responses of the present Barriers, and watches the responders.
class ResponseTracker {
 public:
  /// `listened` is called from any thread with the topic of a response that is not sent back.
  ResponseTracker(Ros& ros, std::function<void(const std::string&)> listened)
      : ros_(ros), listened_(std::move(listened)) {}

  /// Set the expected responses; due responses of others are forgotten.
  void expect(const std::vector<ExpectedResponse>& expected) {
    if (expected == expected_) return;
    expected_ = expected;
    std::map<ExpectedResponse, std::uint64_t> due;
    for (const ExpectedResponse& response : expected) due[response] = due_[response];
    due_ = std::move(due);
  }

  /// Count messages by topic before they are published; return whether a response is due.
  bool due(const std::vector<std::string>& published) {
    for (const std::string& topic : published) {
      for (auto& [response, count] : due_) count += response.of == topic;
    }
    return !due_topic().empty();
  }

  /// Note a message of ROS.
  void received(const std::string& topic) {
    for (auto& [response, count] : due_) {
      if (response.topic == topic && count) --count;
    }
  }

  /// Return a topic on which a response is due; empty when none is.
  std::string due_topic() const {
    for (const auto& [response, count] : due_) {
      if (count) return response.topic;
    }
    return {};
  }

  /// Expect no response of publishers that have left.
  void forgive_absent(std::int64_t now_nanos) {
    if (now_nanos - checked_nanos_ < kCheckNanos) return;
    checked_nanos_ = now_nanos;
    for (const ExpectedResponse& response : expected_) {
      const std::set<std::string> now = ros_.publishers(response.topic);
      std::set<std::string>& before = publishers_[response.topic];
      const bool has_left = !std::includes(now.begin(), now.end(), before.begin(), before.end());
      if (now.empty() || has_left) due_[response] = 0;
      before = now;
    }
  }

  /// Expect no response to what has been published.
  void forgive_all() {
    for (auto& [response, count] : due_) count = 0;
  }

  /// Return a topic without the publisher or subscriber that has to respond; else empty.
  std::string unmatched_topic(const std::set<std::string>& published) const {
    for (const ExpectedResponse& response : expected_) {
      if (!published.count(response.of)) continue;
      if (!has_responder(response)) return response.topic;
      if (!ros_.has_subscriber(response.of)) return response.of;
    }
    return {};
  }

  /// Subscribe to responses; return whether an endpoint is new since the last update.
  bool update(const std::set<std::string>& published, const std::set<TopicKey>& subscribed) {
    for (const ExpectedResponse& response : expected_) {
      const bool is_leased = response.msg_type && subscribed.count({response.msg_type, response.topic});
      if (response.msg_type && !is_leased) subscriptions_.erase(response.topic);
      if (!published.count(response.of) || subscriptions_.count(response.topic)) continue;
      if (is_leased) {
        subscriptions_[response.topic] = nullptr;  // a leased subscription
      } else if (!response.msg_type) {
        auto kept = ros_.listen(response.topic,
                                [this, topic = response.topic] { listened_(topic); });
        if (kept) subscriptions_[response.topic] = std::move(kept);
      }
      publishers_[response.topic] = ros_.publishers(response.topic);
    }
    std::set<std::string> matched;
    for (const ExpectedResponse& response : expected_) {
      if (has_responder(response)) matched.insert(response.topic);
      if (ros_.has_subscriber(response.of)) matched.insert(response.of);
    }
    const bool is_new =
        !std::includes(matched_.begin(), matched_.end(), matched.begin(), matched.end());
    matched_ = std::move(matched);
    return is_new;
  }

 private:
  static constexpr std::int64_t kCheckNanos = udp_bridge::kNanos / 2;

  bool has_responder(const ExpectedResponse& response) const {
    return subscriptions_.count(response.topic) && ros_.has_publisher(response.topic);
  }

  Ros& ros_;
  const std::function<void(const std::string&)> listened_;
  std::vector<ExpectedResponse> expected_;
  std::map<ExpectedResponse, std::uint64_t> due_;
  std::map<std::string, std::unique_ptr<Subscription>> subscriptions_;
  std::map<std::string, std::set<std::string>> publishers_;
  std::set<std::string> matched_;
  std::int64_t checked_nanos_ = 0;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_RESPONSE_TRACKER_HPP
