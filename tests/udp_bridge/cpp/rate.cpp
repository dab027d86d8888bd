// SPDX-License-Identifier: Apache-2.0
// How long a Receiver takes for a message: rate DATAGRAMS ROUNDS. Takes the datagrams of a file, which
// are one message, so many times, each with the next number; prints processor nanoseconds a message.

#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iterator>

#include "udp_bridge.hpp"

int main(int, char** argv) {
  std::ifstream file(argv[1], std::ios::binary);
  std::vector<char> text((std::istreambuf_iterator<char>(file)), {});
  auto* data = reinterpret_cast<std::uint8_t*>(text.data());
  const unsigned rounds = static_cast<unsigned>(std::atoi(argv[2]));
  udp_bridge::Receiver receiver;
  std::size_t bytes = 0;
  const std::clock_t begun = std::clock();
  for (unsigned number = 0; number < rounds; ++number) {
    for (std::size_t at = 0; at < text.size();) {
      const std::size_t size = udp_bridge::detail::read_u32(data + at);
      at += 4;
      udp_bridge::detail::write_u32(data + at + 2, number);
      receiver.take(
          data + at, size, 1, number, [&](udp_bridge::Message&& m) { bytes += m.body.size(); },
          [](const std::uint8_t*, std::size_t) {});
      at += size;
    }
  }
  const double seconds = static_cast<double>(std::clock() - begun) / CLOCKS_PER_SEC;
  if (receiver.counters.messages != rounds || !bytes) return 1;
  std::printf("%.0f\n", seconds / rounds * 1e9);
}
