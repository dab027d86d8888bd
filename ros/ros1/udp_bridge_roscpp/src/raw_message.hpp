// SPDX-License-Identifier: Apache-2.0
//
// A serialized message of ROS 1, whose type is known at run time only.

#ifndef UDP_BRIDGE_ROSCPP_RAW_MESSAGE_HPP
#define UDP_BRIDGE_ROSCPP_RAW_MESSAGE_HPP

#include <ros/message_traits.h>
#include <ros/serialization.h>

#include <cstring>
#include <memory>
#include <string>

#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_roscpp {

/// A type as ROS 1 compares and describes it.
struct RosType {
  std::string name, checksum, definition;
};

/// Bytes as ROS 1 sends them. To roscpp it is a message of `type`, or of any one where it is read.
struct RawMessage {
  std::shared_ptr<const RosType> type;
  udp_bridge_cpp::Bytes bytes;
};

}  // namespace udp_bridge_roscpp

namespace ros {
namespace message_traits {

template <>
struct IsMessage<udp_bridge_roscpp::RawMessage> : TrueType {};
template <>
struct IsMessage<const udp_bridge_roscpp::RawMessage> : TrueType {};

template <>
struct MD5Sum<udp_bridge_roscpp::RawMessage> {
  static const char* value() { return "*"; }
  static const char* value(const udp_bridge_roscpp::RawMessage& message) {
    return message.type->checksum.c_str();
  }
};

template <>
struct DataType<udp_bridge_roscpp::RawMessage> {
  static const char* value() { return "*"; }
  static const char* value(const udp_bridge_roscpp::RawMessage& message) {
    return message.type->name.c_str();
  }
};

template <>
struct Definition<udp_bridge_roscpp::RawMessage> {
  static const char* value() { return ""; }
  static const char* value(const udp_bridge_roscpp::RawMessage& message) {
    return message.type->definition.c_str();
  }
};

}  // namespace message_traits

namespace serialization {

template <>
struct Serializer<udp_bridge_roscpp::RawMessage> {
  template <typename Stream>
  static void write(Stream& stream, const udp_bridge_roscpp::RawMessage& message) {
    const auto size = static_cast<std::uint32_t>(message.bytes.size());
    std::memcpy(stream.advance(size), message.bytes.data(), size);
  }
  template <typename Stream>
  static void read(Stream& stream, udp_bridge_roscpp::RawMessage& message) {
    const std::uint32_t size = stream.getLength();
    const std::uint8_t* begin = stream.advance(size);
    message.bytes.assign(begin, begin + size);
  }
  static std::uint32_t serializedLength(const udp_bridge_roscpp::RawMessage& message) {
    return static_cast<std::uint32_t>(message.bytes.size());
  }
};

}  // namespace serialization
}  // namespace ros

#endif  // UDP_BRIDGE_ROSCPP_RAW_MESSAGE_HPP
