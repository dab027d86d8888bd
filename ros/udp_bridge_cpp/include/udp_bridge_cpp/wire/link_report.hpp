// SPDX-License-Identifier: Apache-2.0
//
// The body of a LinkReport (Control, kind 2), PROTOCOL.md, section 6.

#ifndef UDP_BRIDGE_CPP_WIRE_LINK_REPORT_HPP
#define UDP_BRIDGE_CPP_WIRE_LINK_REPORT_HPP

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_cpp {

/// What a socket received, and why datagrams were refused.
struct LinkReport {
  static constexpr std::size_t kMaxReasons = 32;

  std::uint32_t receive_buffer = 0;
  std::uint64_t datagrams = 0, bytes = 0, kernel_drops = 0;
  std::vector<std::pair<std::uint64_t, std::string>> reasons;  ///< count and name

  /// Take the refusals of a receiver, and the datagrams of strangers.
  void count(const udp_bridge::Counters& counters, std::uint64_t strangers) {
    for (std::size_t i = 1; i < counters.refused.size(); ++i) {
      add(counters.refused[i], udp_bridge::name_of(static_cast<udp_bridge::Refusal>(i)));
    }
    add(strangers, "stranger");
  }

  Bytes pack() const {
    auto rows = reasons;
    std::stable_sort(rows.begin(), rows.end(),
                     [](const auto& a, const auto& b) { return a.first > b.first; });
    rows.resize(std::min(rows.size(), kMaxReasons));
    std::uint64_t refused = 0;
    for (const auto& [count, name] : reasons) refused += count;
    Bytes body(40);
    body[0] = 2;
    udp_bridge::detail::write_u32(body.data() + 4, receive_buffer);
    udp_bridge::detail::write_u64(body.data() + 8, datagrams);
    udp_bridge::detail::write_u64(body.data() + 16, bytes);
    udp_bridge::detail::write_u64(body.data() + 24, refused);
    udp_bridge::detail::write_u64(body.data() + 32, kernel_drops);
    for (const auto& [count, name] : rows) {
      std::array<std::uint8_t, 9> fixed{};
      udp_bridge::detail::write_u64(fixed.data(), count);
      fixed[8] = static_cast<std::uint8_t>(name.size());
      body.insert(body.end(), fixed.begin(), fixed.end());
      body.insert(body.end(), name.begin(), name.end());
    }
    return body;
  }

 private:
  void add(std::uint64_t count, const std::string& name) {
    if (count) reasons.emplace_back(count, name);
  }
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_WIRE_LINK_REPORT_HPP
