// SPDX-License-Identifier: Apache-2.0
//
// One topic of one ROS type: the messages that wait to be published, and its publisher.

#ifndef UDP_BRIDGE_CPP_NODE_PUBLISH_CHANNEL_HPP
#define UDP_BRIDGE_CPP_NODE_PUBLISH_CHANNEL_HPP

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/node/ros.hpp"
#include "udp_bridge_cpp/wire/message.hpp"
#include "udp_bridge_cpp/wire/message_types.hpp"

namespace udp_bridge_cpp {

/// A topic that the node publishes. The members from `publisher` on belong to the publishing
/// thread; the lock of the queue guards those before.
struct PublishChannel {
  PublishChannel(const MessageType& type, std::string its_ros_type, std::string its_topic)
      : row(type),
        ros_type(std::move(its_ros_type)),
        topic(std::move(its_topic)),
        qos(publisher_qos(type, topic, ros_type)) {}

  const MessageType& row;
  const std::string ros_type, topic;
  const TopicQos& qos;
  std::int64_t used_nanos = 0;
  std::deque<Received> waiting;
  std::size_t waiting_bytes = 0;
  std::string refused_as;  ///< why ROS can't take messages of this topic; empty where it can
  bool is_prepared = false;

  std::unique_ptr<Publisher> publisher;
  bool has_warned = false;
  std::map<Address, Bytes> latest;  ///< last body of each sender on a topic of repeated messages

  /// Return whether the oldest waiting message must be dropped.
  bool is_full() const {
    return waiting.size() > qos.waiting && waiting_bytes > qos.waiting_bytes;
  }

  void append(Received&& received) {
    waiting_bytes += received.message.body.size();
    waiting.push_back(std::move(received));
  }

  Received pop() {
    Received received = std::move(waiting.front());
    waiting.pop_front();
    waiting_bytes -= received.message.body.size();
    return received;
  }

  /// Return whether a repeated body changed, and remember it.
  bool is_new(const Received& received) {
    const auto found = latest.find(received.sender);
    if (found != latest.end() && found->second == received.message.body) return false;
    if (latest.size() >= qos.depth) latest.clear();
    latest[received.sender] = received.message.body;
    return true;
  }
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_PUBLISH_CHANNEL_HPP
