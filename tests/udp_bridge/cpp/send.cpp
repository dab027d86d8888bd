// SPDX-License-Identifier: Apache-2.0
// Cuts the body on stdin: send TYPE TOPIC LINK STAMP_NANOS NUMBER_OF_TIMES DATAGRAM_SIZE. Writes
// the datagrams, each behind its length, those of the last time only.

#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <iterator>

#include "udp_bridge.hpp"

int main(int, char** argv) {
  const std::vector<char> text((std::istreambuf_iterator<char>(std::cin)), {});
  const auto* body = reinterpret_cast<const std::uint8_t*>(text.data());
  udp_bridge::Sender sender;
  const int times = std::atoi(argv[5]);
  for (int i = 1; i <= times; ++i) {
    const bool is_sent = sender.send(
        static_cast<std::uint8_t>(std::atoi(argv[1])), argv[2], argv[3], std::atoll(argv[4]), body,
        text.size(), static_cast<std::size_t>(std::atoll(argv[6])),
        [&](const std::uint8_t* head, std::size_t h, const std::uint8_t* part, std::size_t p) {
          if (i < times) return;
          std::uint8_t length[4];
          udp_bridge::detail::write_u32(length, static_cast<std::uint32_t>(h + p));
          std::fwrite(length, 1, 4, stdout);
          std::fwrite(head, 1, h, stdout);
          std::fwrite(part, 1, p, stdout);
        });
    if (!is_sent) return 1;
  }
}
