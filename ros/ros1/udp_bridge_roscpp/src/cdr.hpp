// SPDX-License-Identifier: Apache-2.0
//
// CDR (XCDR1, little-endian) as ROS 1 messages, field by field.
//
// What is shorter than it says, or says more than there is, throws Malformed and nothing else
// happens. Here are the types that node.cpp publishes; a further one is a `read` of its own.

#ifndef UDP_BRIDGE_ROSCPP_CDR_HPP
#define UDP_BRIDGE_ROSCPP_CDR_HPP

#include <geometry_msgs/Twist.h>
#include <nav_msgs/Odometry.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud2.h>

#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers are copied as they lie");

struct Malformed : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Reads a body from its beginning.
class Cdr {
 public:
  Cdr(const std::uint8_t* body, std::size_t size) : at_(body + 4), begin_(at_), end_(body + size) {
    if (size < 4 || body[0] != 0 || body[1] != 1) throw Malformed("no little-endian CDR");
  }

  template <class T>
  T take() {
    T value;
    std::memcpy(&value, bytes(sizeof(T), sizeof(T)), sizeof(T));
    return value;
  }

  std::string text() {
    const auto size = take<std::uint32_t>();  // with the NUL
    const auto* begin = reinterpret_cast<const char*>(bytes(size, 1));
    if (!size || begin[size - 1]) throw Malformed("a text without an end");
    return {begin, size - 1};
  }

  template <class T>
  void numbers(std::vector<T>& to) {
    const auto count = take<std::uint32_t>();
    if (!count) return to.clear();
    const std::uint8_t* begin = bytes(std::size_t{count} * sizeof(T), sizeof(T));
    to.resize(count);
    std::memcpy(to.data(), begin, count * sizeof(T));
  }

  template <class Array>
  void fixed(Array& to) {
    for (auto& value : to) value = take<std::decay_t<decltype(value)>>();
  }

 private:
  const std::uint8_t* bytes(std::size_t size, std::size_t alignment) {
    const std::size_t offset = static_cast<std::size_t>(at_ - begin_);
    const std::size_t pad = (alignment - offset % alignment) % alignment;
    if (static_cast<std::size_t>(end_ - at_) < pad + size) throw Malformed("too short");
    const std::uint8_t* found = at_ + pad;
    at_ = found + size;
    return found;
  }

  const std::uint8_t *at_, *begin_, *end_;
};

inline void read(Cdr& cdr, ros::Time& to) {
  const auto sec = cdr.take<std::int32_t>();
  const auto nsec = cdr.take<std::uint32_t>();
  if (sec < 0 || nsec >= 1000000000) throw Malformed("ROS 1 has no such time");
  to = ros::Time(static_cast<std::uint32_t>(sec), nsec);
}

inline void read(Cdr& cdr, std_msgs::Header& to) {
  read(cdr, to.stamp);
  to.frame_id = cdr.text();
}

inline void read(Cdr& cdr, geometry_msgs::Quaternion& to) {
  for (double* value : {&to.x, &to.y, &to.z, &to.w}) *value = cdr.take<double>();
}

/// Vector3 and Point.
template <class Triple>
void read_triple(Cdr& cdr, Triple& to) {
  for (double* value : {&to.x, &to.y, &to.z}) *value = cdr.take<double>();
}

inline void read(Cdr& cdr, rosgraph_msgs::Clock& to) { read(cdr, to.clock); }

inline void read(Cdr& cdr, sensor_msgs::Imu& to) {
  read(cdr, to.header);
  read(cdr, to.orientation);
  cdr.fixed(to.orientation_covariance);
  read_triple(cdr, to.angular_velocity);
  cdr.fixed(to.angular_velocity_covariance);
  read_triple(cdr, to.linear_acceleration);
  cdr.fixed(to.linear_acceleration_covariance);
}

inline void read(Cdr& cdr, sensor_msgs::LaserScan& to) {
  read(cdr, to.header);
  for (float* value : {&to.angle_min, &to.angle_max, &to.angle_increment, &to.time_increment,
                       &to.scan_time, &to.range_min, &to.range_max}) {
    *value = cdr.take<float>();
  }
  cdr.numbers(to.ranges);
  cdr.numbers(to.intensities);
}

inline void read(Cdr& cdr, nav_msgs::Odometry& to) {
  read(cdr, to.header);
  to.child_frame_id = cdr.text();
  read_triple(cdr, to.pose.pose.position);
  read(cdr, to.pose.pose.orientation);
  cdr.fixed(to.pose.covariance);
  read_triple(cdr, to.twist.twist.linear);
  read_triple(cdr, to.twist.twist.angular);
  cdr.fixed(to.twist.covariance);
}

inline void read(Cdr& cdr, sensor_msgs::PointCloud2& to) {
  read(cdr, to.header);
  to.height = cdr.take<std::uint32_t>();
  to.width = cdr.take<std::uint32_t>();
  for (auto left = cdr.take<std::uint32_t>(); left; --left) {
    sensor_msgs::PointField& field = to.fields.emplace_back();
    field.name = cdr.text();
    field.offset = cdr.take<std::uint32_t>();
    field.datatype = cdr.take<std::uint8_t>();
    field.count = cdr.take<std::uint32_t>();
  }
  to.is_bigendian = cdr.take<std::uint8_t>();
  to.point_step = cdr.take<std::uint32_t>();
  to.row_step = cdr.take<std::uint32_t>();
  cdr.numbers(to.data);
  to.is_dense = cdr.take<std::uint8_t>();
}

/// The other way, for what a robot is sent.
inline std::vector<std::uint8_t> written(const geometry_msgs::Twist& twist) {
  std::vector<std::uint8_t> body = {0, 1, 0, 0};
  for (const geometry_msgs::Vector3* part : {&twist.linear, &twist.angular}) {
    for (const double* value : {&part->x, &part->y, &part->z}) {
      const auto* begin = reinterpret_cast<const std::uint8_t*>(value);
      body.insert(body.end(), begin, begin + sizeof *value);
    }
  }
  return body;
}

#endif  // UDP_BRIDGE_ROSCPP_CDR_HPP
