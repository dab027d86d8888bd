// SPDX-License-Identifier: Apache-2.0
//
// What UDP Bridge sends as topics of ROS 1, and Twists back to who asks for them: a small node on
// udp_bridge.hpp, to be taken as it is or as the beginning of another one.
//
// One thread does all: it receives, publishes (roscpp queues, so no subscriber holds it up) and
// lets roscpp call back. Types other than those in `kinds` are dropped and counted. Repair,
// sealed datagrams, lockstep and diagnostics are udp_bridge_ros1's.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <ros/ros.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <limits>
#include <map>
#include <string>
#include <tuple>

#include "cdr.hpp"
#include "udp_bridge.hpp"

namespace {

constexpr int kWaitMillis = 2;  // for datagrams, while Twists may wait to be sent
constexpr std::size_t kMostInARow = 1000;
constexpr std::uint32_t kQueue = 20;  // messages for each subscriber

std::int64_t steady_nanos() {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

class Bridge {
 public:
  Bridge(int socket, std::uint32_t receive_buffer)
      : socket_(socket), receiver_(limits(receive_buffer)) {}

  /// Receive what there is, after waiting a little for it.
  void turn() {
    pollfd ready{socket_, POLLIN, 0};
    poll(&ready, 1, kWaitMillis);
    for (std::size_t i = 0; i < kMostInARow; ++i) {
      sockaddr_in from{};
      socklen_t length = sizeof from;
      const ssize_t size = recvfrom(socket_, buffer_.data(), buffer_.size(), MSG_DONTWAIT,
                                    reinterpret_cast<sockaddr*>(&from), &length);
      if (size < 0) break;
      const auto sender = udp_bridge::SenderId{from.sin_addr.s_addr} << 16 | from.sin_port;
      receiver_.take(
          buffer_.data(), static_cast<std::size_t>(size), sender, steady_nanos(),
          [&](const udp_bridge::Message& message) { take(message, from); },
          [&](const std::uint8_t* credit, std::size_t bytes) {
            sendto(socket_, credit, bytes, 0, reinterpret_cast<sockaddr*>(&from), sizeof from);
          });
    }
    receiver_.expire(steady_nanos());
    ros::spinOnce();
    for (auto wish = wishes_.begin(); wish != wishes_.end();) {
      wish = wish->second.until_nanos < steady_nanos() ? wishes_.erase(wish) : std::next(wish);
    }
  }

  void tell() const {
    std::uint64_t refused = 0;
    for (const std::uint64_t count : receiver_.counters.refused) refused += count;
    std::printf("published %llu, incomplete %llu, missing %llu, dropped %llu, refused %llu\n",
                static_cast<unsigned long long>(published_),
                static_cast<unsigned long long>(receiver_.counters.incomplete),
                static_cast<unsigned long long>(receiver_.counters.missing),
                static_cast<unsigned long long>(dropped_), static_cast<unsigned long long>(refused));
  }

 private:
  struct Wish {  // of a peer, to be sent a topic
    ros::Subscriber subscriber;
    udp_bridge::Sender sender;  // numbers are counted for each peer
    std::int64_t until_nanos = 0;
  };
  struct Kind {
    const char* default_topic;
    void (Bridge::*publish)(const udp_bridge::Message&, const std::string&);
  };

  static udp_bridge::Limits limits(std::uint32_t receive_buffer) {
    udp_bridge::Limits limits;
    limits.receive_buffer = receive_buffer;
    return limits;
  }

  void take(const udp_bridge::Message& message, const sockaddr_in& from) {
    static const std::map<std::uint8_t, Kind> kinds = {
        {1, {"/points", &Bridge::publish<sensor_msgs::PointCloud2>}},
        {2, {"/imu", &Bridge::publish<sensor_msgs::Imu>}},
        {8, {"/clock", &Bridge::publish<rosgraph_msgs::Clock>}},
        {32, {"/scan", &Bridge::publish<sensor_msgs::LaserScan>}},
        {36, {"/odom", &Bridge::publish<nav_msgs::Odometry>}}};
    const udp_bridge::Header& header = message.header;
    if (header.msg_type == udp_bridge::kSubscribe) return heed(message, from);
    const auto found = kinds.find(header.msg_type);
    if (found == kinds.end()) {
      ++dropped_;
      return;
    }
    const Kind& kind = found->second;
    try {
      (this->*kind.publish)(message, header.topic.empty() ? kind.default_topic : header.topic);
      ++published_;
    } catch (const std::exception&) {  // a body that is not its type, or a name that ROS refuses
      ++dropped_;
    }
  }

  template <class Ros>
  void publish(const udp_bridge::Message& message, const std::string& topic) {
    auto ros_message = boost::make_shared<Ros>();
    Cdr cdr(message.body.data(), message.body.size());
    read(cdr, *ros_message);
    const auto key = std::make_pair(message.header.msg_type, topic);
    auto publisher = publishers_.find(key);
    if (publisher == publishers_.end()) {
      publisher = publishers_.emplace(key, node_.advertise<Ros>(topic, kQueue)).first;
    }
    publisher->second.publish(ros_message);
  }

  /// Send Twists to who wants them, as long as that is said again.
  void heed(const udp_bridge::Message& message, const sockaddr_in& to) {
    udp_bridge::Subscribe asked;
    udp_bridge::Subscribe::parse(message.body.data(), message.body.size(), asked);
    if (asked.wanted_type != 9) {
      ++dropped_;
      return;
    }
    const std::string topic = message.header.topic.empty() ? "/cmd_vel" : message.header.topic;
    const auto key = std::make_tuple(topic, to.sin_addr.s_addr, to.sin_port);
    if (!asked.wanted) {
      wishes_.erase(key);
      return;
    }
    const auto [wish, is_new] = wishes_.try_emplace(key);
    Wish& wished = wish->second;
    wished.until_nanos = asked.lease_s ? steady_nanos() + asked.lease_s * udp_bridge::kNanos
                                       : std::numeric_limits<std::int64_t>::max();
    if (!is_new) return;
    const boost::function<void(const geometry_msgs::Twist::ConstPtr&)> send =
        [this, &wished, topic, to](const geometry_msgs::Twist::ConstPtr& twist) {
          const std::vector<std::uint8_t> body = written(*twist);
          const auto stamp = static_cast<std::int64_t>(ros::Time::now().toNSec());
          wished.sender.send(9, topic, "", stamp, body.data(), body.size(), udp_bridge::kMtu,
                             [&](const std::uint8_t* head, std::size_t head_size,
                                 const std::uint8_t* part, std::size_t part_size) {
                               std::vector<std::uint8_t> datagram(head, head + head_size);
                               datagram.insert(datagram.end(), part, part + part_size);
                               sendto(socket_, datagram.data(), datagram.size(), 0,
                                      reinterpret_cast<const sockaddr*>(&to), sizeof to);
                             });
        };
    wished.subscriber = node_.subscribe<geometry_msgs::Twist>(topic, kQueue, send);
  }

  ros::NodeHandle node_;
  int socket_;
  udp_bridge::Receiver receiver_;
  std::array<std::uint8_t, 65536> buffer_{};
  std::map<std::pair<std::uint8_t, std::string>, ros::Publisher> publishers_;
  std::map<std::tuple<std::string, in_addr_t, in_port_t>, Wish> wishes_;
  std::uint64_t published_ = 0, dropped_ = 0;
};

}  // namespace

int main(int count, char** words) {
  ros::init(count, words, "udp_bridge");
  const std::string bind_to = ros::NodeHandle("~").param<std::string>("bind", "127.0.0.1:7511");
  const std::size_t colon = bind_to.rfind(':');
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(std::atoi(bind_to.c_str() + colon + 1)));
  const int handle = socket(AF_INET, SOCK_DGRAM, 0);
  if (colon == std::string::npos ||
      inet_pton(AF_INET, bind_to.substr(0, colon).c_str(), &address.sin_addr) != 1 ||
      bind(handle, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
    std::fprintf(stderr, "can't receive at %s: ~bind is a free HOST:PORT, such as 0.0.0.0:7511\n",
                 bind_to.c_str());
    return 2;
  }
  int buffer = 8 << 20;
  socklen_t length = sizeof buffer;
  setsockopt(handle, SOL_SOCKET, SO_RCVBUF, &buffer, length);
  getsockopt(handle, SOL_SOCKET, SO_RCVBUF, &buffer, &length);
  Bridge bridge(handle, static_cast<std::uint32_t>(buffer));
  std::printf("udp_bridge_roscpp: receiving at %s\n", bind_to.c_str());
  std::fflush(stdout);
  while (ros::ok()) bridge.turn();
  bridge.tell();
  close(handle);
}
