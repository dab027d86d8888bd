// SPDX-License-Identifier: Apache-2.0
//
// The two clocks of a node, in nanoseconds.

#ifndef UDP_BRIDGE_CPP_IO_CLOCK_HPP
#define UDP_BRIDGE_CPP_IO_CLOCK_HPP

#include <chrono>
#include <cstdint>

namespace udp_bridge_cpp {

/// A clock that never goes back.
inline std::int64_t steady_nanos() {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// The wall clock since the POSIX epoch.
inline std::int64_t wall_nanos() {
  return std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_IO_CLOCK_HPP
