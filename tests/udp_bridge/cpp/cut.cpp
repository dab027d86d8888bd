// SPDX-License-Identifier: Apache-2.0
// How bodies are cut: for each line of stdin, BODY_SIZE HEADER_SIZE DATAGRAM_SIZE, the bytes of a
// part, 0 where the message can't be sent.

#include <iostream>

#include "udp_bridge.hpp"

int main() {
  for (std::size_t size, header, largest; std::cin >> size >> header >> largest;) {
    std::cout << udp_bridge::Sender::part_size_of(size, header, largest) << "\n";
  }
}
