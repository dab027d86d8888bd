// SPDX-License-Identifier: Apache-2.0
// Datagrams of a file, each behind its length as a uint32 and its sender as a byte, through a
// Receiver, so many nanoseconds apart: receive DATAGRAMS BODIES APART. One line a message (type seq
// sec nsec parts topic|link size, its body in a file beside), one a refusal, one of counts.

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

#include "udp_bridge.hpp"

int main(int, char** argv) {
  std::ifstream file(argv[1], std::ios::binary);
  const std::vector<char> text((std::istreambuf_iterator<char>(file)), {});
  const auto* data = reinterpret_cast<const std::uint8_t*>(text.data());
  std::ofstream bodies(argv[2], std::ios::binary);
  udp_bridge::Limits limits;
  limits.receive_buffer = 1u << 30;  // so that no Credit is due before the end of a message
  udp_bridge::Receiver receiver(limits);
  std::int64_t now = 0;
  const std::int64_t apart = std::atoll(argv[3]);
  std::size_t credits = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t size = udp_bridge::detail::read_u32(data + at);
    const std::uint8_t sender = data[at + 4];
    at += 5;
    const auto before = receiver.counters.refused;
    receiver.take(
        data + at, size, sender, now += apart,
        [&](udp_bridge::Message&& m) {
          const udp_bridge::Header& h = m.header;
          std::printf("message %d %u %d %d %d %zu %s|%s\n", h.msg_type, h.seq_number, h.time_sec,
                      h.time_nsec, h.parts_max, m.body.size(), h.topic.c_str(), h.link.c_str());
          bodies.write(reinterpret_cast<const char*>(m.body.data()),
                       static_cast<std::streamsize>(m.body.size()));
        },
        [&](const std::uint8_t*, std::size_t) { ++credits; });
    for (std::size_t i = 0; i < before.size(); ++i) {
      if (receiver.counters.refused[i] > before[i]) {
        std::printf("refused %s\n", udp_bridge::name_of(static_cast<udp_bridge::Refusal>(i)));
      }
    }
    at += size;
  }
  receiver.give_up_all();
  const udp_bridge::Counters& c = receiver.counters;
  std::printf("counts %llu %llu %zu %zu\n", static_cast<unsigned long long>(c.messages),
              static_cast<unsigned long long>(c.incomplete), receiver.memory_bytes(), credits);
}
