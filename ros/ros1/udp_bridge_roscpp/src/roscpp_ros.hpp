// SPDX-License-Identifier: Apache-2.0
//
// ROS 1 as the bridge needs it: publishers and subscriptions of serialized messages, converted from
// and to CDR.

#ifndef UDP_BRIDGE_ROSCPP_ROSCPP_ROS_HPP
#define UDP_BRIDGE_ROSCPP_ROSCPP_ROS_HPP

#include <ros/network.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "conversion_plan.hpp"
#include "definition.hpp"
#include "known_definitions.hpp"
#include "raw_message.hpp"
#include "udp_bridge_cpp/node/ros.hpp"
#include "udp_bridge_cpp/wire/message_types.hpp"

namespace udp_bridge_roscpp {

using udp_bridge_cpp::RosMessage;

/// A publisher that converts bodies.
class RoscppPublisher : public udp_bridge_cpp::Publisher {
 public:
  RoscppPublisher(ros::Publisher publisher, std::shared_ptr<const RosType> type,
                  ConversionPlan plan, bool is_description)
      : publisher_(std::move(publisher)),
        type_(std::move(type)),
        plan_(std::move(plan)),
        is_description_(is_description) {}

  ~RoscppPublisher() override { publisher_.shutdown(); }

  void publish(const std::uint8_t* cdr, std::size_t size) override {
    RawMessage message{type_, plan_.to_ros1(cdr, size)};
    if (plan_.is_stamped()) udp_bridge::detail::write_u32(message.bytes.data(), ++seq_);
    if (is_description_) {  // ROS 1 reads the robot description from a parameter
      ros::param::set(publisher_.getTopic(),
                      std::string(message.bytes.begin() + 4, message.bytes.end()));
    }
    publisher_.publish(message);
  }

 private:
  ros::Publisher publisher_;
  const std::shared_ptr<const RosType> type_;
  const ConversionPlan plan_;
  const bool is_description_;
  std::uint32_t seq_ = 0;
};

/// A subscription of roscpp.
class RoscppSubscription : public udp_bridge_cpp::Subscription {
 public:
  explicit RoscppSubscription(ros::Subscriber subscriber) : subscriber_(std::move(subscriber)) {}
  ~RoscppSubscription() override { subscriber_.shutdown(); }

 private:
  ros::Subscriber subscriber_;
};

/// A node of ROS 1; its functions may be called from any thread.
class RoscppRos : public udp_bridge_cpp::Ros {
 public:
  std::unique_ptr<udp_bridge_cpp::Publisher> advertise(
      const std::string& ros_type, const std::string& topic, const udp_bridge_cpp::MessageType& row,
      const udp_bridge_cpp::TopicQos& qos) override {
    const auto [type, plan] = converted_type(ros_type);
    ros::AdvertiseOptions options(topic, static_cast<std::uint32_t>(qos.depth), type->checksum,
                                  type->name, type->definition);
    options.latch = qos.is_latched;
    const ros::Publisher publisher = node_.advertise(options);
    const std::lock_guard lock(mutex_);
    publishers_[topic].push_back(publisher);
    return std::make_unique<RoscppPublisher>(publisher, type, plan,
                                             row.number == udp_bridge_cpp::kDescription);
  }

  std::unique_ptr<udp_bridge_cpp::Subscription> subscribe(
      const std::string& ros_type, const std::string& topic, const udp_bridge_cpp::MessageType&,
      std::function<void(RosMessage&&)> take) override {
    const auto [type, plan] = converted_type(ros_type);
    return make_subscription(
        topic, type->name, type->checksum,
        [this, take = std::move(take), plan = plan](const RawMessage& message) {
          try {
            take({plan.to_cdr(message.bytes.data(), message.bytes.size()), plan.is_stamped()});
          } catch (const MalformedMessage&) {
            ++malformed_;
          }
        });
  }

  /// Messages are not converted, so each counts by its number, as one without a stamp does.
  std::unique_ptr<udp_bridge_cpp::Subscription> listen(
      const std::string& topic, std::function<void(RosMessage&&)> take) override {
    return make_subscription(topic, "*", "*", [take = std::move(take)](const RawMessage&) {
      take({{}, false});
    });
  }

  std::string type_of(const std::string& topic) override {
    ros::master::V_TopicInfo topics;
    ros::master::getTopics(topics);
    const std::string name = ros::names::resolve(topic);
    for (const ros::master::TopicInfo& info : topics) {
      const std::size_t slash = info.datatype.find('/');
      if (info.name == name && slash != std::string::npos) {
        return info.datatype.substr(0, slash) + "/msg" + info.datatype.substr(slash);
      }
    }
    return {};
  }

  /// Connections of this node count: a message that is published before a connection exists does
  /// not reach the subscriber, and the master also lists nodes that have crashed.
  std::set<std::string> publishers(const std::string& topic) override {
    const std::string name = ros::names::resolve(topic);
    const ros::XMLRPCManagerPtr& manager = ros::XMLRPCManager::instance();
    XmlRpc::XmlRpcClient own(ros::network::getHost().c_str(),
                             static_cast<int>(manager->getServerPort()), "/");
    XmlRpc::XmlRpcValue request, response, rows;
    request[0] = ros::this_node::getName();
    std::set<std::string> found;
    if (!own.execute("getBusInfo", request, response) ||
        !manager->validateXmlrpcResponse("getBusInfo", response, rows)) {
      return found;
    }
    for (int i = 0; i < rows.size(); ++i) {  // id, peer, direction, transport, topic, ...
      XmlRpc::XmlRpcValue& row = rows[i];
      if (std::string(row[2]) == "i" && std::string(row[4]) == name) {
        found.insert(std::to_string(static_cast<int>(row[0])));
      }
    }
    return found;
  }

  bool has_publisher(const std::string& topic) override {
    return is_connected(subscribers_, topic, [](const ros::Subscriber& subscriber) {
      return subscriber.getNumPublishers() > 0;
    });
  }
  /// A topic that only other nodes publish counts as consumed: ROS 1 does not tell this node.
  bool has_subscriber(const std::string& topic, bool is_own) override {
    return is_own || is_connected(publishers_, topic, [](const ros::Publisher& publisher) {
      return publisher.getNumSubscribers() > 0;
    });
  }

  std::int64_t now_nanos() override { return static_cast<std::int64_t>(ros::Time::now().toNSec()); }
  void info(const std::string& line) override {
    ROS_INFO("%s", line.c_str());
    std::fflush(stdout);  // it may be a pipe
  }
  void warn(const std::string& line) override { ROS_WARN("%s", line.c_str()); }

  /// Messages of ROS that did not match their type.
  std::uint64_t malformed() const { return malformed_; }

 private:
  static constexpr std::uint32_t kQueue = 10;  // messages of a subscription

  struct ConvertedType {
    std::shared_ptr<const RosType> type;
    ConversionPlan plan;
  };

  /// Return the ROS 1 type of a ROS 2 type name, and the conversion; throw TypeNotInstalled.
  ConvertedType converted_type(const std::string& ros_type) {
    const std::size_t slash = ros_type.find('/');
    const std::string name = ros_type.substr(0, slash) + ros_type.substr(ros_type.rfind('/'));
    const std::lock_guard lock(mutex_);
    auto found = types_.find(name);
    if (found == types_.end()) {
      ConversionPlan plan(definitions_, name);
      auto type = std::make_shared<const RosType>(
          RosType{name, definitions_.checksum(name), definitions_.full_text(name)});
      found = types_.emplace(name, ConvertedType{std::move(type), std::move(plan)}).first;
    }
    return found->second;
  }

  std::unique_ptr<udp_bridge_cpp::Subscription> make_subscription(
      const std::string& topic, const std::string& type, const std::string& checksum,
      std::function<void(const RawMessage&)> take) {
    ros::SubscribeOptions options;
    options.initByFullCallbackType<const boost::shared_ptr<const RawMessage>&>(
        topic, kQueue,
        [take = std::move(take)](const boost::shared_ptr<const RawMessage>& message) {
          take(*message);
        });
    options.datatype = type;
    options.md5sum = checksum;
    options.transport_hints.tcpNoDelay();
    const ros::Subscriber subscriber = node_.subscribe(options);
    const std::lock_guard lock(mutex_);
    subscribers_[topic].push_back(subscriber);
    return std::make_unique<RoscppSubscription>(subscriber);
  }

  /// Return whether a handle of a topic has a connection; handles that ended are forgotten.
  template <class Handle, class Count>
  bool is_connected(std::map<std::string, std::vector<Handle>>& handles, const std::string& topic,
                    Count count) {
    const std::lock_guard lock(mutex_);
    std::vector<Handle>& of_topic = handles[topic];
    of_topic.erase(std::remove_if(of_topic.begin(), of_topic.end(),
                                  [](const Handle& handle) { return !handle; }),
                   of_topic.end());
    return std::any_of(of_topic.begin(), of_topic.end(), count);
  }

  ros::NodeHandle node_;
  std::mutex mutex_;  // guards all below but the last
  std::map<std::string, std::vector<ros::Publisher>> publishers_;
  std::map<std::string, std::vector<ros::Subscriber>> subscribers_;
  Definitions definitions_ = known_definitions();
  std::map<std::string, ConvertedType> types_;
  std::atomic<std::uint64_t> malformed_{0};
};

}  // namespace udp_bridge_roscpp

#endif  // UDP_BRIDGE_ROSCPP_ROSCPP_ROS_HPP
