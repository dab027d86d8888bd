// SPDX-License-Identifier: Apache-2.0
//
// ROS 2 as the bridge needs it: generic publishers and subscriptions of serialized messages.
//
// A body of the bridge is the serialized message of ROS 2, so nothing is converted.

#ifndef UDP_BRIDGE_CPP_RCLCPP_ROS_HPP
#define UDP_BRIDGE_CPP_RCLCPP_ROS_HPP

#include <ament_index_cpp/get_package_share_directory.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rclcpp/typesupport_helpers.hpp>

#include <cstring>
#include <fstream>
#include <functional>
#include <memory>
#include <set>
#include <sstream>
#include <string>
#include <utility>

#include "udp_bridge_cpp/node/ros.hpp"

namespace udp_bridge_cpp {

/// A generic publisher.
class RclcppPublisher : public Publisher {
 public:
  explicit RclcppPublisher(rclcpp::GenericPublisher::SharedPtr publisher)
      : publisher_(std::move(publisher)) {}

  void publish(const std::uint8_t* cdr, std::size_t size) override {
    rclcpp::SerializedMessage message(size);
    auto& raw = message.get_rcl_serialized_message();
    std::memcpy(raw.buffer, cdr, size);
    raw.buffer_length = size;
    publisher_->publish(message);
  }

 private:
  rclcpp::GenericPublisher::SharedPtr publisher_;
};

/// A generic subscription.
class RclcppSubscription : public Subscription {
 public:
  explicit RclcppSubscription(rclcpp::GenericSubscription::SharedPtr subscription)
      : subscription_(std::move(subscription)) {}

 private:
  rclcpp::GenericSubscription::SharedPtr subscription_;
};

/// A node of ROS 2; its functions may be called from any thread.
class RclcppRos : public Ros {
 public:
  explicit RclcppRos(rclcpp::Node& node) : node_(node) {}

  std::unique_ptr<Publisher> advertise(const std::string& ros_type, const std::string& topic,
                                       const MessageType&, const TopicQos& qos) override {
    require_type(ros_type);
    // Reliable matches reliable and best-effort subscribers alike.
    rclcpp::QoS profile{rclcpp::KeepLast(qos.depth)};
    profile.reliable();
    if (qos.is_latched) profile.transient_local();
    return std::make_unique<RclcppPublisher>(
        node_.create_generic_publisher(topic, ros_type, profile));
  }

  std::unique_ptr<Subscription> subscribe(const std::string& ros_type, const std::string& topic,
                                          const MessageType& row,
                                          std::function<void(RosMessage&&)> take) override {
    require_type(ros_type);
    // Best effort matches every publisher. A latched map reaches a latched subscription only.
    rclcpp::QoS profile{rclcpp::KeepLast(row.qos.is_latched ? 1 : kDepth)};
    if (row.qos.is_latched) {
      profile.reliable().transient_local();
    } else {
      profile.best_effort();
    }
    return make_subscription(ros_type, topic, profile, std::move(take));
  }

  std::unique_ptr<Subscription> listen(const std::string& topic,
                                       std::function<void(RosMessage&&)> take) override {
    const auto found = node_.get_publishers_info_by_topic(topic);
    if (found.empty()) return nullptr;
    const auto& publisher = found.front();
    // Lockstep waits for each message, so none may be lost between hosts.
    rclcpp::QoS profile{rclcpp::KeepLast(kListeningDepth)};
    if (publisher.qos_profile().reliability() == rclcpp::ReliabilityPolicy::Reliable) {
      profile.reliable();
    } else {
      profile.best_effort();
    }
    return make_subscription(publisher.topic_type(), topic, profile, std::move(take));
  }

  std::string type_of(const std::string& topic) override {
    const auto found = node_.get_publishers_info_by_topic(topic);
    return found.empty() ? std::string() : found.front().topic_type();
  }

  std::set<std::string> publishers(const std::string& topic) override {
    std::set<std::string> identities;
    for (const auto& info : node_.get_publishers_info_by_topic(topic)) {
      const auto& gid = info.endpoint_gid();
      identities.emplace(gid.begin(), gid.end());
    }
    return identities;
  }

  bool has_publisher(const std::string& topic) override {
    return node_.count_publishers(topic) > 0;
  }
  bool has_subscriber(const std::string& topic, bool is_own) override {
    return node_.count_subscribers(topic) > (is_own ? 1u : 0u);
  }

  std::int64_t now_nanos() override { return node_.now().nanoseconds(); }

  void info(const std::string& line) override {
    RCLCPP_INFO(node_.get_logger(), "%s", line.c_str());
  }
  void warn(const std::string& line) override {
    RCLCPP_WARN(node_.get_logger(), "%s", line.c_str());
  }

 private:
  static constexpr std::size_t kDepth = 10;
  static constexpr std::size_t kListeningDepth = 100;

  /// Throw TypeNotInstalled where this host lacks a type.
  static void require_type(const std::string& ros_type) {
    try {
      rclcpp::get_typesupport_library(ros_type, "rosidl_typesupport_cpp");
    } catch (const std::runtime_error& error) {
      const std::string package = ros_type.substr(0, ros_type.find('/'));
      throw TypeNotInstalled("ROS package " + package + " is not installed (" + error.what() +
                             "). Fix: install it, then start this node again");
    }
  }

  std::unique_ptr<Subscription> make_subscription(const std::string& ros_type,
                                                  const std::string& topic,
                                                  const rclcpp::QoS& profile,
                                                  std::function<void(RosMessage&&)> take) {
    return std::make_unique<RclcppSubscription>(node_.create_generic_subscription(
        topic, ros_type, profile,
        [take = std::move(take), is_stamped = is_stamped(ros_type)](
            std::shared_ptr<rclcpp::SerializedMessage> message) {
          const auto& raw = message->get_rcl_serialized_message();
          take({Bytes(raw.buffer, raw.buffer + raw.buffer_length), is_stamped});
        }));
  }

  /// Whether messages of a type begin with a std_msgs/Header, as its installed definition says.
  static bool is_stamped(const std::string& ros_type) {
    const std::size_t slash = ros_type.find('/');
    std::ifstream file(ament_index_cpp::get_package_share_directory(ros_type.substr(0, slash)) +
                       ros_type.substr(slash) + ".msg");
    for (std::string line; std::getline(file, line);) {
      std::istringstream words(line);
      std::string type, name;
      words >> type >> name;
      if (!type.empty() && type[0] != '#') return type == "std_msgs/Header" && name == "header";
    }
    return false;
  }

  rclcpp::Node& node_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_RCLCPP_ROS_HPP
