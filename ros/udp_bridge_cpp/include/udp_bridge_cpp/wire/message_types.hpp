// SPDX-License-Identifier: Apache-2.0
//
// The types of PROTOCOL.md, section 4, that have a ROS type, and how each is published.

#ifndef UDP_BRIDGE_CPP_WIRE_MESSAGE_TYPES_HPP
#define UDP_BRIDGE_CPP_WIRE_MESSAGE_TYPES_HPP

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace udp_bridge_cpp {

constexpr std::uint8_t kClock = 8;
constexpr std::uint8_t kTransforms = 35;
constexpr std::uint8_t kDescription = 39;

/// Quality of service of a topic, and limits of its publish queue.
struct TopicQos {
  std::size_t depth;          ///< messages that ROS keeps for slow subscribers
  std::size_t waiting;        ///< messages that may wait; a newer one drops the oldest
  std::size_t waiting_bytes;  ///< more messages may wait if they take no more than this
  bool is_latched;            ///< a late subscriber gets the last message
  bool is_repeated;           ///< the sender repeats it; it is published again only when it changes
};

/// A row of the table of types.
struct MessageType {
  std::uint8_t number;
  std::string_view name;
  std::string_view ros_type;       ///< full ROS 2 type name; `*` where the body names it
  std::string_view default_topic;  ///< what an empty topic stands for; empty where there is none
  TopicQos qos;
};

// This table and the next two are generated from wire/types.py and node/topic_qos.py by
// `python -m tools.wire_types`.
inline constexpr MessageType kMessageTypes[] = {
    {1, "PointCloud2", "sensor_msgs/msg/PointCloud2", "/points",
     {5, 3, 1048576, false, false}},
    {2, "Imu", "sensor_msgs/msg/Imu", "/imu",
     {200, 400, 0, false, false}},
    {3, "CompressedImage", "sensor_msgs/msg/CompressedImage", "/image/compressed",
     {5, 3, 1048576, false, false}},
    {4, "NavSatFix", "sensor_msgs/msg/NavSatFix", "/fix",
     {200, 400, 0, false, false}},
    {5, "WheelEncoders", "groundlink_msgs/msg/WheelEncoders", "/wheels",
     {200, 400, 0, false, false}},
    {6, "Range", "sensor_msgs/msg/Range", "/range",
     {200, 400, 0, false, false}},
    {8, "Clock", "rosgraph_msgs/msg/Clock", "/clock",
     {1, 10, 0, false, false}},
    {9, "Twist", "geometry_msgs/msg/Twist", "/cmd_vel",
     {200, 400, 0, false, false}},
    {10, "PoseStamped", "geometry_msgs/msg/PoseStamped", "/pose",
     {200, 400, 0, false, false}},
    {11, "OccupancyGrid", "nav_msgs/msg/OccupancyGrid", "/map",
     {1, 3, 0, true, false}},
    {32, "LaserScan", "sensor_msgs/msg/LaserScan", "/scan",
     {200, 400, 0, false, false}},
    {33, "Image", "sensor_msgs/msg/Image", "/image",
     {5, 3, 1048576, false, false}},
    {34, "CameraInfo", "sensor_msgs/msg/CameraInfo", "/camera_info",
     {200, 400, 0, false, false}},
    {35, "TFMessage", "tf2_msgs/msg/TFMessage", "/tf",
     {200, 400, 0, false, false}},
    {36, "Odometry", "nav_msgs/msg/Odometry", "/odom",
     {200, 400, 0, false, false}},
    {37, "JointState", "sensor_msgs/msg/JointState", "/joint_states",
     {200, 400, 0, false, false}},
    {38, "TwistStamped", "geometry_msgs/msg/TwistStamped", "/cmd_vel",
     {200, 400, 0, false, false}},
    {39, "String", "std_msgs/msg/String", "/robot_description",
     {1, 16, 0, true, true}},
    {40, "Path", "nav_msgs/msg/Path", "/plan",
     {200, 400, 0, false, false}},
    {67, "Typed", "*", "",
     {50, 3, 1048576, false, false}},
};

/// The qos of a TFMessage on `tf_static`.
inline constexpr TopicQos kStaticTransforms = {
    16, 16, 0, true, true
};

/// How a ROS type without a number of its own is published.
struct RosTypeQos {
  std::string_view ros_type;
  TopicQos qos;
};

inline constexpr RosTypeQos kQosByRosType[] = {
    {"vision_msgs/msg/LabelInfo", {1, 3, 0, true, false}},
};

/// Return the row of a type with a ROS type; nullptr for any other number.
inline const MessageType* message_type(std::uint8_t number) {
  for (const MessageType& row : kMessageTypes) {
    if (row.number == number) return &row;
  }
  return nullptr;
}

/// Return how messages of a wire type and a ROS type are published on a topic.
inline const TopicQos& publisher_qos(const MessageType& row, std::string_view topic,
                                     std::string_view ros_type) {
  const bool is_static = topic.substr(topic.rfind('/') + 1) == "tf_static";
  if (row.number == kTransforms && is_static) return kStaticTransforms;
  for (const RosTypeQos& named : kQosByRosType) {
    if (named.ros_type == ros_type) return named.qos;
  }
  return row.qos;
}

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_WIRE_MESSAGE_TYPES_HPP
