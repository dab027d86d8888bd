// SPDX-License-Identifier: Apache-2.0
//
// Ledger of the messages that ROS owes, topic by topic: no ROS, no clock, no threads.
//
// A message that causes responses adds to what their topics owe; each message on these topics pays
// one back, and causes further responses in turn. DDS may deliver a response before its cause when
// two nodes publish them, and a topic is then in credit for a moment. As expected responses form no
// loop, all responses have come when no topic owes anything.
//
// A message that nothing caused, such as that of a timer, leaves a topic in credit. `settle`
// forgets this credit, or a later message would not be waited for. It cannot tell whether the
// cause, itself one too many, is still on its way. So the credit is restored when a topic before it
// gets such a message: else the response to that, which has come already, would be owed for good.

#ifndef UDP_BRIDGE_CPP_NODE_RESPONSE_LEDGER_HPP
#define UDP_BRIDGE_CPP_NODE_RESPONSE_LEDGER_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "udp_bridge_cpp/wire/barrier.hpp"

namespace udp_bridge_cpp {

/// What each topic owes.
class ResponseLedger {
 public:
  using Stamp = std::optional<std::int64_t>;

  /// `expected` has no loop.
  explicit ResponseLedger(const std::vector<ExpectedResponse>& expected = {}) {
    for (const ExpectedResponse& response : expected) {
      if (std::find(expected_.begin(), expected_.end(), response) != expected_.end()) continue;
      expected_.push_back(response);
      owed_[response.topic] = 0;
      if (response.every == ExpectedResponse::kJoined) {
        joined_causes_[response.topic].insert(response.of);
      }
    }
  }

  /// Count a message that is published in ROS; one without a stamp counts by its number. What came
  /// before the first caused nothing. Return whether a node works on it: a node that joins messages
  /// only keeps those before the last of a stamp, so their order does not matter.
  bool published(const std::string& topic, Stamp stamp_nanos) {
    has_begun_ = true;
    return count(topic, stamp_nanos);
  }

  /// Count a message that ROS published, as a response and as a cause of further ones.
  void received(const std::string& topic, Stamp stamp_nanos) {
    const auto owed = owed_.find(topic);
    if (owed == owed_.end()) return;
    if (owed->second <= 0) restore(topic);
    --owed->second;
    if (has_begun_) count(topic, stamp_nanos);
  }

  /// Return a topic that owes a message; empty when none does.
  std::string owing() const {
    for (const ExpectedResponse& response : expected_) {
      if (owed_.at(response.topic) > 0) return response.topic;
    }
    return {};
  }

  /// Return the topics with the number of messages that nothing caused, and forget these messages.
  std::vector<std::pair<std::string, std::int64_t>> settle() {
    std::vector<std::pair<std::string, std::int64_t>> surplus;
    for (auto& [topic, owed] : owed_) {
      if (owed >= 0) continue;
      surplus.emplace_back(topic, -std::exchange(owed, 0));
      forgotten_[topic] += surplus.back().second;
      count_anew(topic);
    }
    return surplus;
  }

  /// Expect no message on a topic for what was published; its publisher counts anew.
  void forgive(const std::string& topic) {
    owed_[topic] = forgotten_[topic] = 0;
    count_anew(topic);
    stamps_.erase(topic);
  }

  /// Return topics with all those on which messages of them cause responses, however far.
  std::set<std::string> caused(std::set<std::string> topics) const {
    for (std::size_t before = 0; topics.size() > before;) {
      before = topics.size();
      for (const ExpectedResponse& response : expected_) {
        if (topics.count(response.of)) topics.insert(response.topic);
      }
    }
    return topics;
  }

 private:
  /// Stamps of a joined topic that lack a message on one of its causes; older ones are forgotten.
  static constexpr std::size_t kMaxStamps = 1024;

  bool count(const std::string& topic, Stamp stamp_nanos) {
    if (!stamp_nanos) stamp_nanos = ++numbers_[topic];
    bool is_worked_on = false;
    for (const ExpectedResponse& response : expected_) {
      if (response.of != topic) continue;
      const bool is_owed = is_due(response, *stamp_nanos);
      owed_[response.topic] += is_owed;
      is_worked_on |= is_owed || response.every != ExpectedResponse::kJoined;
    }
    return is_worked_on;
  }

  /// Count the causes of a topic from now on, as its publisher does.
  void count_anew(const std::string& topic) {
    for (const ExpectedResponse& response : expected_) {
      if (response.topic == topic) counts_.erase(response);
    }
  }

  /// Give the topics after a topic their forgotten credit again.
  void restore(const std::string& cause) {
    for (const std::string& topic : caused({cause})) {
      if (topic != cause) owed_[topic] -= std::exchange(forgotten_[topic], 0);
    }
  }

  bool is_due(const ExpectedResponse& response, std::int64_t stamp_nanos) {
    if (response.every == ExpectedResponse::kJoined) return is_joined(response, stamp_nanos);
    if (response.every < 2) return true;
    int& count = counts_[response];
    count = (count + 1) % response.every;
    return count == 0;
  }

  /// Return whether a stamp now has a message of every cause.
  bool is_joined(const ExpectedResponse& response, std::int64_t stamp_nanos) {
    auto& stamps = stamps_[response.topic];
    std::set<std::string>& seen = stamps[stamp_nanos];
    seen.insert(response.of);
    if (seen == joined_causes_[response.topic]) {
      stamps.erase(stamp_nanos);
      return true;
    }
    if (stamps.size() > kMaxStamps) stamps.erase(stamps.begin());
    return false;
  }

  std::vector<ExpectedResponse> expected_;
  std::map<std::string, std::int64_t> owed_;       // below 0: in credit
  std::map<std::string, std::int64_t> forgotten_;  // messages that nothing had caused yet
  bool has_begun_ = false;
  std::map<std::string, std::set<std::string>> joined_causes_;
  std::map<ExpectedResponse, int> counts_;       // of causes, since the last response
  std::map<std::string, std::int64_t> numbers_;  // of messages without a stamp
  /// Causes so far, by joined topic and stamp.
  std::map<std::string, std::map<std::int64_t, std::set<std::string>>> stamps_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_RESPONSE_LEDGER_HPP
