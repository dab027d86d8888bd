// SPDX-License-Identifier: Apache-2.0
//
// Definitions of the types with numbers, from the headers that this node is compiled with. So they
// need no .msg files, which Debian's packages lack.

#ifndef UDP_BRIDGE_ROSCPP_KNOWN_DEFINITIONS_HPP
#define UDP_BRIDGE_ROSCPP_KNOWN_DEFINITIONS_HPP

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <geometry_msgs/Twist.h>
#include <geometry_msgs/TwistStamped.h>
#include <nav_msgs/OccupancyGrid.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/JointState.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/NavSatFix.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/Range.h>
#include <std_msgs/String.h>

#include "definition.hpp"

namespace udp_bridge_roscpp {

template <class... Message>
void add_compiled(Definitions& to) {
  using namespace ros::message_traits;
  (to.add(datatype<Message>(), definition<Message>()), ...);
}

/// Return the definitions of all types with numbers.
inline Definitions known_definitions() {
  Definitions definitions;
  add_compiled<geometry_msgs::PoseStamped, geometry_msgs::TransformStamped, geometry_msgs::Twist,
               geometry_msgs::TwistStamped, nav_msgs::OccupancyGrid, nav_msgs::Odometry,
               nav_msgs::Path, rosgraph_msgs::Clock, sensor_msgs::CameraInfo,
               sensor_msgs::CompressedImage, sensor_msgs::Image, sensor_msgs::Imu,
               sensor_msgs::JointState, sensor_msgs::LaserScan, sensor_msgs::NavSatFix,
               sensor_msgs::PointCloud2, sensor_msgs::Range, std_msgs::String>(definitions);
  // Two types whose headers are in no package of Debian's roscpp.
  definitions.add("tf2_msgs/TFMessage", "geometry_msgs/TransformStamped[] transforms\n");
  definitions.add("groundlink_msgs/WheelEncoders",
                  "std_msgs/Header header\nstring[] name\nint64[] ticks\n");
  return definitions;
}

}  // namespace udp_bridge_roscpp

#endif  // UDP_BRIDGE_ROSCPP_KNOWN_DEFINITIONS_HPP
