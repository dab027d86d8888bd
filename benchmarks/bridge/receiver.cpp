// SPDX-License-Identifier: Apache-2.0
// A user's receiver on udp_bridge.hpp, as plain as one can be: receiver BUFFER prints its port, then
// the time at which each image was handed over. It keeps one while the next one comes.

#include <arpa/inet.h>
#include <sys/socket.h>

#include <cstdio>
#include <cstdlib>
#include <ctime>

#include "udp_bridge.hpp"

namespace {

constexpr std::uint8_t kImage = 33;
constexpr std::int64_t kSpinNanos = 50000;

std::int64_t now() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * udp_bridge::kNanos + t.tv_nsec;
}

void report(long long number) {
  std::printf("%lld\n", number);
  std::fflush(stdout);
}

}  // namespace

int main(int, char** argv) {
  const int s = socket(AF_INET, SOCK_DGRAM, 0);
  int buffer = std::atoi(argv[1]);
  socklen_t size = sizeof buffer;
  setsockopt(s, SOL_SOCKET, SO_RCVBUF, &buffer, size);
  getsockopt(s, SOL_SOCKET, SO_RCVBUF, &buffer, &size);
  sockaddr_in own{};
  own.sin_family = AF_INET;
  own.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  size = sizeof own;
  if (bind(s, reinterpret_cast<sockaddr*>(&own), size) != 0) return 1;
  getsockname(s, reinterpret_cast<sockaddr*>(&own), &size);
  report(ntohs(own.sin_port));

  udp_bridge::Limits limits;
  limits.receive_buffer = static_cast<std::uint32_t>(buffer);
  udp_bridge::Receiver receiver(limits);
  udp_bridge::Message kept;
  std::vector<std::uint8_t> datagram(1 << 16);
  bool is_within = false;  // a message: its next part comes soon, so do not sleep
  for (;;) {
    sockaddr_in from{};
    size = sizeof from;
    auto* address = reinterpret_cast<sockaddr*>(&from);
    ssize_t got = -1;
    for (const std::int64_t until = now() + kSpinNanos; is_within && got < 0 && now() < until;) {
      got = recvfrom(s, datagram.data(), datagram.size(), MSG_DONTWAIT, address, &size);
    }
    if (got < 0) got = recvfrom(s, datagram.data(), datagram.size(), 0, address, &size);
    if (got < 0) continue;
    is_within = datagram[6] + 1 < datagram[7];  // part_number, parts_max
    const udp_bridge::SenderId sender = std::uint64_t{from.sin_addr.s_addr} << 16 | from.sin_port;
    receiver.take(
        datagram.data(), static_cast<std::size_t>(got), sender, now(),
        [&](udp_bridge::Message&& message) {
          if (message.header.msg_type != kImage) return;
          report(now());
          kept = std::move(message);
        },
        [&](const std::uint8_t* credit, std::size_t n) { sendto(s, credit, n, 0, address, size); });
  }
}
