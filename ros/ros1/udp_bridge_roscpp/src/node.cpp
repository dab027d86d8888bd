// SPDX-License-Identifier: Apache-2.0
//
// A small ROS 1 node on udp_bridge.hpp: it publishes what UDP Bridge sends, and sends Twists to peers
// that subscribe. Use it as it is, or as a start for a node of your own.
//
// One thread receives, publishes and runs the callbacks of roscpp. roscpp queues messages, so no
// subscriber blocks it. Types other than those in `publications` are dropped and counted. Repair,
// sealed datagrams, lockstep and diagnostics are udp_bridge_ros1's.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <ros/ros.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <tuple>

#include "cdr.hpp"
#include "udp_bridge.hpp"

namespace {

constexpr int kWaitMillis = 2;  // for datagrams, while Twists may wait to be sent
constexpr std::size_t kMostInARow = 1000;
constexpr std::uint32_t kQueue = 20;  // messages for each subscriber
constexpr std::size_t kMostPublishers = 256;
constexpr std::int64_t kSilentNanos = 10 * udp_bridge::kNanos;  // then a publisher gives way
constexpr std::size_t kMostLeases = 64;
constexpr std::int64_t kLongestLease = 3600 * udp_bridge::kNanos;

std::int64_t steady_nanos() {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::int64_t wall_nanos() {
  return std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// Read HOST:PORT with a numeric IPv4 host; return whether it is one.
bool parse_address(const std::string& text, sockaddr_in& to) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos || colon + 1 == text.size()) return false;
  char* end = nullptr;
  const unsigned long port = std::strtoul(text.c_str() + colon + 1, &end, 10);
  to = {};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  return !*end && port <= 65535 &&
         inet_pton(AF_INET, text.substr(0, colon).c_str(), &to.sin_addr) == 1;
}

class Bridge {
 public:
  /// With a peer, datagrams of others are dropped; its port 0 stands for any.
  Bridge(int socket, std::uint32_t receive_buffer, const sockaddr_in* peer)
      : socket_(socket), peer_(peer), receiver_(limits(receive_buffer)) {}

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
      if (!is_peer(from)) {
        ++strangers_;
        continue;
      }
      const auto sender = udp_bridge::SenderId{from.sin_addr.s_addr} << 16 | from.sin_port;
      receiver_.take(
          buffer_.data(), static_cast<std::size_t>(size), sender, steady_nanos(),
          [&](const udp_bridge::Message& message) { return take(message, from); },
          [&](const std::uint8_t* credit, std::size_t bytes) {
            sendto(socket_, credit, bytes, 0, reinterpret_cast<sockaddr*>(&from), sizeof from);
          });
    }
    if (steady_nanos() >= due_nanos_) {
      report();
      due_nanos_ = steady_nanos() + udp_bridge::kNanos;
    }
    receiver_.expire(steady_nanos());
    ros::spinOnce();
    for (auto lease = leases_.begin(); lease != leases_.end();) {
      lease = lease->second.until_nanos < steady_nanos() ? leases_.erase(lease) : std::next(lease);
    }
  }

  /// Tell each gateway what became of its messages.
  void report() {
    receiver_.report(steady_nanos(), wall_nanos(),
                     [&](udp_bridge::SenderId id, const std::uint8_t* report, std::size_t bytes) {
                       sockaddr_in to{};
                       to.sin_family = AF_INET;
                       to.sin_addr.s_addr = static_cast<in_addr_t>(id >> 16);
                       to.sin_port = static_cast<in_port_t>(id);
                       sendto(socket_, report, bytes, 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
                     });
  }

  void tell() const {
    std::uint64_t refused = 0;
    for (const std::uint64_t count : receiver_.counters.refused) refused += count;
    refused += strangers_;
    std::printf("published %llu, incomplete %llu, missing %llu, dropped %llu, refused %llu\n",
                static_cast<unsigned long long>(published_),
                static_cast<unsigned long long>(receiver_.counters.incomplete),
                static_cast<unsigned long long>(receiver_.counters.missing),
                static_cast<unsigned long long>(dropped_), static_cast<unsigned long long>(refused));
  }

 private:
  struct Lease {  // of a peer, to be sent a topic
    ros::Subscriber subscriber;
    udp_bridge::Sender sender;  // numbers are counted for each peer
    std::int64_t until_nanos = 0;
  };
  struct Publisher {
    ros::Publisher publisher;
    std::int64_t used_nanos = 0;
  };
  struct Publication {
    const char* default_topic;
    bool (Bridge::*publish)(const udp_bridge::Message&, const std::string&);
  };

  static udp_bridge::Limits limits(std::uint32_t receive_buffer) {
    udp_bridge::Limits limits;
    limits.receive_buffer = receive_buffer;
    return limits;
  }

  bool is_peer(const sockaddr_in& from) const {
    return !peer_ || (from.sin_addr.s_addr == peer_->sin_addr.s_addr &&
                      (!peer_->sin_port || from.sin_port == peer_->sin_port));
  }

  /// Publish a message, or serve its request; return false where neither is possible.
  bool take(const udp_bridge::Message& message, const sockaddr_in& from) {
    static const std::map<std::uint8_t, Publication> publications = {
        {1, {"/points", &Bridge::publish<sensor_msgs::PointCloud2>}},
        {2, {"/imu", &Bridge::publish<sensor_msgs::Imu>}},
        {8, {"/clock", &Bridge::publish<rosgraph_msgs::Clock>}},
        {32, {"/scan", &Bridge::publish<sensor_msgs::LaserScan>}},
        {36, {"/odom", &Bridge::publish<nav_msgs::Odometry>}}};
    const udp_bridge::Header& header = message.header;
    if (header.msg_type == udp_bridge::kSubscribe) return subscribe(message, from);
    const auto found = publications.find(header.msg_type);
    bool is_published = false;
    if (found != publications.end()) {
      const Publication& publication = found->second;
      try {
        const std::string& topic = header.topic.empty() ? publication.default_topic : header.topic;
        is_published = (this->*publication.publish)(message, topic);
      } catch (const std::exception&) {  // a body that is not its type, or a name that ROS refuses
      }
    }
    ++(is_published ? published_ : dropped_);
    return is_published;
  }

  /// Make room for a publisher, which one that is silent may have; return whether there is any.
  bool has_room() {
    if (publishers_.size() < kMostPublishers) return true;
    const auto silent = std::min_element(
        publishers_.begin(), publishers_.end(),
        [](const auto& a, const auto& b) { return a.second.used_nanos < b.second.used_nanos; });
    if (steady_nanos() - silent->second.used_nanos < kSilentNanos) return false;
    publishers_.erase(silent);
    return true;
  }

  template <class Ros>
  bool publish(const udp_bridge::Message& message, const std::string& topic) {
    auto ros_message = boost::make_shared<Ros>();
    Cdr cdr(message.body.data(), message.body.size());
    read(cdr, *ros_message);
    const auto key = std::make_pair(message.header.msg_type, topic);
    auto publisher = publishers_.find(key);
    if (publisher == publishers_.end()) {
      if (!has_room()) return false;
      publisher = publishers_.emplace(key, Publisher{node_.advertise<Ros>(topic, kQueue)}).first;
    }
    publisher->second.used_nanos = steady_nanos();
    publisher->second.publisher.publish(ros_message);
    return true;
  }

  /// Send Twists to a peer that subscribes, until its lease ends; return whether that is possible.
  bool subscribe(const udp_bridge::Message& message, const sockaddr_in& to) {
    udp_bridge::Subscribe asked;
    udp_bridge::Subscribe::parse(message.body.data(), message.body.size(), asked);
    if (asked.wanted_type != 9) {
      ++dropped_;
      return false;
    }
    const std::string topic = message.header.topic.empty() ? "/cmd_vel" : message.header.topic;
    const auto key = std::make_tuple(topic, to.sin_addr.s_addr, to.sin_port);
    if (!asked.wanted) {
      leases_.erase(key);
      return true;
    }
    if (leases_.size() >= kMostLeases && !leases_.count(key)) {
      ++dropped_;
      return false;
    }
    const auto [entry, is_new] = leases_.try_emplace(key);
    Lease& held = entry->second;
    const std::int64_t lease = asked.lease_s * udp_bridge::kNanos;
    held.until_nanos = steady_nanos() + (lease ? std::min(lease, kLongestLease) : kLongestLease);
    if (!is_new) return true;
    const boost::function<void(const geometry_msgs::Twist::ConstPtr&)> send =
        [this, &held, topic, to](const geometry_msgs::Twist::ConstPtr& twist) {
          const std::vector<std::uint8_t> body = written(*twist);
          const auto stamp = static_cast<std::int64_t>(ros::Time::now().toNSec());
          held.sender.send(9, topic, "", stamp, body.data(), body.size(), udp_bridge::kMtu,
                             [&](const std::uint8_t* head, std::size_t head_size,
                                 const std::uint8_t* part, std::size_t part_size) {
                               std::vector<std::uint8_t> datagram(head, head + head_size);
                               datagram.insert(datagram.end(), part, part + part_size);
                               sendto(socket_, datagram.data(), datagram.size(), 0,
                                      reinterpret_cast<const sockaddr*>(&to), sizeof to);
                             });
        };
    try {
      held.subscriber = node_.subscribe<geometry_msgs::Twist>(topic, kQueue, send);
    } catch (const ros::Exception&) {  // a name that ROS refuses, or a topic of another type
      leases_.erase(entry);
      ++dropped_;
      return false;
    }
    return true;
  }

  ros::NodeHandle node_;
  int socket_;
  const sockaddr_in* peer_;
  udp_bridge::Receiver receiver_;
  std::array<std::uint8_t, 65536> buffer_{};
  std::map<std::pair<std::uint8_t, std::string>, Publisher> publishers_;
  std::map<std::tuple<std::string, in_addr_t, in_port_t>, Lease> leases_;
  std::uint64_t published_ = 0, dropped_ = 0, strangers_ = 0;
  std::int64_t due_nanos_ = 0;  // of the next report
};

}  // namespace

int main(int count, char** words) {
  ros::init(count, words, "udp_bridge");
  ros::NodeHandle own("~");
  const std::string bind_to = own.param<std::string>("bind", "127.0.0.1:7511");
  const std::string peer_text = own.param<std::string>("peer", "");
  sockaddr_in address{}, peer{};
  if (!peer_text.empty() && !parse_address(peer_text, peer)) {
    std::fprintf(stderr, "~peer: expected IPv4:PORT, such as 10.0.0.1:7510; got %s\n",
                 peer_text.c_str());
    return 2;
  }
  const int handle = socket(AF_INET, SOCK_DGRAM, 0);
  if (!parse_address(bind_to, address) ||
      bind(handle, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
    std::fprintf(stderr, "~bind: expected a free IPv4:PORT, such as 0.0.0.0:7511; got %s\n",
                 bind_to.c_str());
    return 2;
  }
  const bool is_local = ntohl(address.sin_addr.s_addr) >> 24 == 127;
  if (!is_local && peer_text.empty()) {  // it validates no addresses
    std::fprintf(stderr,
                 "~peer: other hosts reach %s; expected the gateway's IPv4:PORT (port 0: any)\n",
                 bind_to.c_str());
    return 2;
  }
  int buffer = 8 << 20;
  socklen_t length = sizeof buffer;
  setsockopt(handle, SOL_SOCKET, SO_RCVBUF, &buffer, length);
  getsockopt(handle, SOL_SOCKET, SO_RCVBUF, &buffer, &length);
  Bridge bridge(handle, static_cast<std::uint32_t>(buffer), peer_text.empty() ? nullptr : &peer);
  std::printf("udp_bridge_roscpp: receiving at %s\n", bind_to.c_str());
  std::fflush(stdout);
  while (ros::ok()) bridge.turn();
  for (int i = 0; i < 3; ++i) bridge.report();  // one may be lost
  bridge.tell();
  close(handle);
}
