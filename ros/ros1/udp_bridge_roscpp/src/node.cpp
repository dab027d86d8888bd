// SPDX-License-Identifier: Apache-2.0
//
// The ROS 1 node: rosrun udp_bridge_roscpp udp_bridge_roscpp _bind:=HOST:PORT.

#include <ros/ros.h>
#include <xmlrpcpp/XmlRpcException.h>

#include <cstdio>
#include <exception>
#include <string>

#include "roscpp_ros.hpp"
#include "udp_bridge_cpp/io/termination.hpp"
#include "udp_bridge_cpp/node/bridge_node.hpp"

namespace {

/// Return the settings that a user gave as private parameters; a number or a boolean is text, too.
udp_bridge_cpp::Settings settings() {
  const ros::NodeHandle own("~");
  udp_bridge_cpp::Settings settings;
  settings.each([&](const std::string& name, std::string& value) {
    XmlRpc::XmlRpcValue given;
    if (!own.getParam(name, given)) return;
    switch (given.getType()) {
      case XmlRpc::XmlRpcValue::TypeBoolean:
        value = static_cast<bool>(given) ? "true" : "false";
        break;
      case XmlRpc::XmlRpcValue::TypeInt: value = std::to_string(static_cast<int>(given)); break;
      default: value = static_cast<std::string>(given); break;
    }
  });
  return settings;
}

int run() {
  const udp_bridge_cpp::Termination termination;
  udp_bridge_roscpp::RoscppRos ros;
  udp_bridge_cpp::BridgeNode bridge(ros, settings());
  ros::AsyncSpinner spinner(1);
  spinner.start();
  while (ros::ok() && !termination.is_requested()) {
  }
  std::printf("%s\n", bridge.close().c_str());
  spinner.stop();
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "udp_bridge", ros::init_options::NoSigintHandler);
  int code = 2;
  try {
    code = run();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "udp_bridge_roscpp: %s\n", error.what());
  } catch (const XmlRpc::XmlRpcException& error) {
    std::fprintf(stderr, "udp_bridge_roscpp: %s\n", error.getMessage().c_str());
  }
  ros::shutdown();
  return code;
}
