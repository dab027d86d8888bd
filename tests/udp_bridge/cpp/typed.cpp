// SPDX-License-Identifier: Apache-2.0
// Bodies of a file, each behind its length as a uint32: one line for each, with the ROS type and the
// offset of the CDR, or `type_name` where the body has no valid name. What is packed again differs: 1.

#include <cstdio>
#include <fstream>
#include <iterator>

#include "udp_bridge.hpp"

int main(int, char** argv) {
  std::ifstream file(argv[1], std::ios::binary);
  const std::vector<char> text((std::istreambuf_iterator<char>(file)), {});
  const auto* data = reinterpret_cast<const std::uint8_t*>(text.data());
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t size = udp_bridge::detail::read_u32(data + at);
    const std::vector<std::uint8_t> body(data + at + 4, data + at + 4 + size);
    at += 4 + size;
    udp_bridge::Typed typed;
    if (!udp_bridge::Typed::parse(body.data(), size, typed)) {
      std::puts("type_name");
      continue;
    }
    const std::vector<std::uint8_t> again = udp_bridge::Typed::pack(
        typed.ros_type, body.data() + typed.offset, size - typed.offset);
    std::printf("%s %zu %d\n", typed.ros_type.c_str(), typed.offset, again == body);
  }
}
