// SPDX-License-Identifier: Apache-2.0
//
// The interface to ROS: publishers, subscriptions, the graph, time and a log.

#ifndef UDP_BRIDGE_CPP_NODE_ROS_HPP
#define UDP_BRIDGE_CPP_NODE_ROS_HPP

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>

#include "udp_bridge_cpp/wire/message.hpp"
#include "udp_bridge_cpp/wire/message_types.hpp"

namespace udp_bridge_cpp {

/// A ROS type is not installed on this host; the text names the package.
struct TypeNotInstalled : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A publisher of CDR bodies, until it is destroyed.
class Publisher {
 public:
  virtual ~Publisher() = default;
  /// Publish a body with its encapsulation; throw any std::exception where it is malformed.
  virtual void publish(const std::uint8_t* cdr, std::size_t size) = 0;
};

/// A subscription, until it is destroyed.
class Subscription {
 public:
  virtual ~Subscription() = default;
};

/// A message of ROS: its CDR, and whether it begins with a std_msgs/Header.
struct RosMessage {
  Bytes cdr;
  bool is_stamped = false;
};

/// Access to ROS 1 or ROS 2. Called from the processing and the publishing thread.
class Ros {
 public:
  virtual ~Ros() = default;

  /// Return a publisher; throw TypeNotInstalled or any other std::exception.
  virtual std::unique_ptr<Publisher> advertise(const std::string& ros_type,
                                               const std::string& topic, const MessageType& row,
                                               const TopicQos& qos) = 0;
  /// Have `take` called with each message, from any thread; throw any std::exception.
  virtual std::unique_ptr<Subscription> subscribe(const std::string& ros_type,
                                                  const std::string& topic, const MessageType& row,
                                                  std::function<void(RosMessage&&)> take) = 0;
  /// Have `take` called with each message of a topic of any type, from any thread; return nullptr
  /// while the type is unknown. A ROS that does not convert such messages passes empty ones.
  virtual std::unique_ptr<Subscription> listen(const std::string& topic,
                                               std::function<void(RosMessage&&)> take) = 0;

  /// Return the full ROS 2 type name of a published topic; empty without a publisher.
  virtual std::string type_of(const std::string& topic) = 0;
  /// Return identities of a topic's publishers; a restarted publisher has a new one.
  virtual std::set<std::string> publishers(const std::string& topic) = 0;
  /// Return whether a topic that the node subscribes to has a publisher.
  virtual bool has_publisher(const std::string& topic) = 0;
  /// Return whether a topic has a subscriber, besides the bridge itself if `is_own`.
  virtual bool has_subscriber(const std::string& topic, bool is_own) = 0;

  /// Return ROS time, which is sim time with `use_sim_time`.
  virtual std::int64_t now_nanos() = 0;

  virtual void info(const std::string& line) = 0;
  virtual void warn(const std::string& line) = 0;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_ROS_HPP
