// SPDX-License-Identifier: Apache-2.0
//
// The ROS 2 node: ros2 run udp_bridge_cpp udp_bridge_cpp --ros-args -p bind:=HOST:PORT.

#include <rclcpp/rclcpp.hpp>

#include <cstdio>
#include <exception>
#include <memory>
#include <string>
#include <thread>

#include "rclcpp_ros.hpp"
#include "udp_bridge_cpp/io/termination.hpp"
#include "udp_bridge_cpp/node/bridge_node.hpp"

namespace {

/// Return the settings that a user gave as parameters; a number or a boolean is text, too.
udp_bridge_cpp::Settings settings_of(rclcpp::Node& node) {
  udp_bridge_cpp::Settings settings;
  settings.each([&](const std::string& name, std::string& value) {
    rcl_interfaces::msg::ParameterDescriptor descriptor;
    descriptor.dynamic_typing = true;
    value = rclcpp::to_string(
        node.declare_parameter(name, rclcpp::ParameterValue(value), descriptor));
  });
  return settings;
}

/// Runs the callbacks of a node in a thread of its own.
class Spinner {
 public:
  explicit Spinner(const rclcpp::Node::SharedPtr& node) {
    executor_.add_node(node);
    thread_ = std::thread([this] { executor_.spin(); });
  }
  ~Spinner() {
    executor_.cancel();
    thread_.join();
  }
  Spinner(const Spinner&) = delete;
  Spinner& operator=(const Spinner&) = delete;

 private:
  rclcpp::executors::SingleThreadedExecutor executor_;
  std::thread thread_;
};

int run() {
  const udp_bridge_cpp::Termination termination;
  const auto node = std::make_shared<rclcpp::Node>("udp_bridge");
  udp_bridge_cpp::RclcppRos ros(*node);
  udp_bridge_cpp::BridgeNode bridge(ros, settings_of(*node));
  const Spinner spinner(node);
  while (rclcpp::ok() && !termination.is_requested()) {
  }
  ros.info(bridge.close());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  rclcpp::init(argc, argv, rclcpp::InitOptions(), rclcpp::SignalHandlerOptions::None);
  int code = 2;
  try {
    code = run();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "udp_bridge_cpp: %s\n", error.what());
  }
  rclcpp::shutdown();
  return code;
}
