// SPDX-License-Identifier: Apache-2.0
//
// MD5 (RFC 1321): ROS 1 identifies a message type by that of its definition.

#ifndef UDP_BRIDGE_ROSCPP_MD5_HPP
#define UDP_BRIDGE_ROSCPP_MD5_HPP

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>

namespace udp_bridge_roscpp {

/// Return the digest of a text as 32 lower-case digits.
inline std::string md5(std::string text) {
  static constexpr std::array<std::uint32_t, 16> shifts = {7, 12, 17, 22, 5, 9,  14, 20,
                                                           4, 11, 16, 23, 6, 10, 15, 21};
  std::array<std::uint32_t, 4> state = {0x67452301, 0xefcdab89, 0x98badcfe, 0x10325476};
  const std::uint64_t bits = std::uint64_t{text.size()} * 8;
  text += '\x80';
  text.resize((text.size() + 8 + 63) / 64 * 64, '\0');
  for (std::size_t i = 0; i < 8; ++i) text[text.size() - 8 + i] = static_cast<char>(bits >> 8 * i);
  for (std::size_t block = 0; block < text.size(); block += 64) {
    auto [a, b, c, d] = state;
    for (std::uint32_t i = 0; i < 64; ++i) {
      const std::uint32_t round = i / 16;
      std::uint32_t mixed = 0, word = 0;
      switch (round) {
        case 0: mixed = (b & c) | (~b & d), word = i; break;
        case 1: mixed = (d & b) | (~d & c), word = (5 * i + 1) % 16; break;
        case 2: mixed = b ^ c ^ d, word = (3 * i + 5) % 16; break;
        default: mixed = c ^ (b | ~d), word = 7 * i % 16; break;
      }
      std::uint32_t part = 0;
      for (std::uint32_t k = 0; k < 4; ++k) {
        const auto byte = static_cast<std::uint8_t>(text[block + 4 * word + k]);
        part |= std::uint32_t{byte} << 8 * k;
      }
      const auto sine = static_cast<std::uint32_t>(std::abs(std::sin(i + 1.0)) * 4294967296.0);
      const std::uint32_t sum = a + mixed + sine + part;
      const std::uint32_t shift = shifts[4 * round + i % 4];
      a = d;
      d = c;
      c = b;
      b += sum << shift | sum >> (32 - shift);
    }
    state = {state[0] + a, state[1] + b, state[2] + c, state[3] + d};
  }
  std::string digest;
  for (const std::uint32_t value : state) {
    for (int k = 0; k < 4; ++k) {
      std::array<char, 3> digits{};
      std::snprintf(digits.data(), digits.size(), "%02x", value >> 8 * k & 0xFF);
      digest += digits.data();
    }
  }
  return digest;
}

}  // namespace udp_bridge_roscpp

#endif  // UDP_BRIDGE_ROSCPP_MD5_HPP
