// SPDX-License-Identifier: Apache-2.0
//
// Receives /imu from a gateway, commands the vehicle to turn, and prints the turn rate that the IMU
// measures. Takes the place of the ROS node: turn [PORT [RADPS]].

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "udp_bridge.hpp"

namespace {

constexpr std::uint8_t kImu = 2;
constexpr std::uint8_t kTwist = 9;
constexpr std::int64_t kCommandNanos = udp_bridge::kNanos / 20;

template <class Clock>
std::int64_t nanos() {
  return std::chrono::nanoseconds(Clock::now().time_since_epoch()).count();
}

/// A body of geometry_msgs/Twist: 4 bytes that say little-endian CDR, then 6 numbers.
std::array<std::uint8_t, 52> twist(double linear_mps, double angular_radps) {
  std::array<std::uint8_t, 52> body{0, 1, 0, 0};
  std::memcpy(body.data() + 4, &linear_mps, sizeof linear_mps);
  std::memcpy(body.data() + 4 + 5 * sizeof(double), &angular_radps, sizeof angular_radps);
  return body;
}

/// The turn rate about z of a sensor_msgs/Imu. Numbers are aligned to 8 bytes after the first 4.
double turn_rate_radps(const std::vector<std::uint8_t>& body) {
  std::uint32_t frame_bytes = 0;
  if (body.size() < 16) return 0.0;
  std::memcpy(&frame_bytes, body.data() + 12, sizeof frame_bytes);
  const std::size_t numbers = 4 + (12 + frame_bytes + 7) / 8 * 8;
  const std::size_t at = numbers + (4 + 9 + 2) * sizeof(double);  // orientation, covariance, x, y
  double rate = 0.0;
  if (at + sizeof rate <= body.size()) std::memcpy(&rate, body.data() + at, sizeof rate);
  return rate;
}

}  // namespace

int main(int argc, char** argv) {
  const int port = argc > 1 ? std::atoi(argv[1]) : 7511;
  const double radps = argc > 2 ? std::atof(argv[2]) : 0.5;
  const int socket_ = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in own{};
  own.sin_family = AF_INET;
  own.sin_port = htons(static_cast<std::uint16_t>(port));
  own.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (bind(socket_, reinterpret_cast<sockaddr*>(&own), sizeof own) != 0) {
    std::perror("bind");
    return 1;
  }
  udp_bridge::Receiver receiver;
  udp_bridge::Sender sender;
  std::vector<std::uint8_t> datagram(1 << 16);
  sockaddr_in gateway{};
  const auto send = [&](const std::uint8_t* data, std::size_t bytes) {
    sendto(socket_, data, bytes, 0, reinterpret_cast<sockaddr*>(&gateway), sizeof gateway);
  };
  std::int64_t command_due = 0, report_due = 0;
  double rate = 0.0;
  for (;;) {
    pollfd ready{socket_, POLLIN, 0};
    poll(&ready, 1, 10);
    const std::int64_t now = nanos<std::chrono::steady_clock>();
    const std::int64_t wall = nanos<std::chrono::system_clock>();
    if (ready.revents & POLLIN) {
      socklen_t length = sizeof gateway;
      const ssize_t size = recvfrom(socket_, datagram.data(), datagram.size(), 0,
                                    reinterpret_cast<sockaddr*>(&gateway), &length);
      if (size < 0) continue;
      const auto id = udp_bridge::SenderId{gateway.sin_addr.s_addr} << 16 | gateway.sin_port;
      receiver.take(
          datagram.data(), static_cast<std::size_t>(size), id, now,
          [&](const udp_bridge::Message& message) {
            if (message.header.msg_type == kImu) rate = turn_rate_radps(message.body);
            return true;
          },
          send);
    }
    if (!gateway.sin_port) continue;  // nothing has arrived yet
    if (now >= command_due) {
      command_due = now + kCommandNanos;
      const auto body = twist(0.2, radps);
      sender.send(kTwist, "/cmd_vel", "", wall, body.data(), body.size(), udp_bridge::kMtu,
                  [&](const std::uint8_t* head, std::size_t h, const std::uint8_t* part,
                      std::size_t p) {
                    std::vector<std::uint8_t> whole(head, head + h);
                    whole.insert(whole.end(), part, part + p);
                    send(whole.data(), whole.size());
                  });
    }
    if (now >= report_due) {
      report_due = now + udp_bridge::kNanos;
      receiver.report(now, wall, [&](udp_bridge::SenderId, const std::uint8_t* data,
                                     std::size_t bytes) { send(data, bytes); });
      receiver.expire(now);
      std::printf("commanded %.2f rad/s, measured %.2f rad/s\n", radps, rate);
      std::fflush(stdout);
    }
  }
}
