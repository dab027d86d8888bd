// SPDX-License-Identifier: Apache-2.0
//
// An IPv4 address with its port.

#ifndef UDP_BRIDGE_CPP_IO_ADDRESS_HPP
#define UDP_BRIDGE_CPP_IO_ADDRESS_HPP

#include <arpa/inet.h>
#include <netinet/in.h>

#include <cstdint>
#include <string>
#include <tuple>

#include "udp_bridge.hpp"

namespace udp_bridge_cpp {

/// The source or destination of datagrams.
struct Address {
  std::uint32_t host = 0;  ///< in host byte order
  std::uint16_t port = 0;

  static Address of(const sockaddr_in& from) {
    return {ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)};
  }

  sockaddr_in to_sockaddr() const {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_addr.s_addr = htonl(host);
    to.sin_port = htons(port);
    return to;
  }

  /// The address as the number by which a Receiver knows its senders.
  udp_bridge::SenderId id() const { return udp_bridge::SenderId{host} << 16 | port; }
  static Address of_id(udp_bridge::SenderId id) {
    return {static_cast<std::uint32_t>(id >> 16), static_cast<std::uint16_t>(id)};
  }

  /// Whether only programs on this host can reach the address.
  bool is_loopback() const { return host >> 24 == 127; }

  std::string text() const {
    return std::to_string(host >> 24) + '.' + std::to_string(host >> 16 & 255) + '.' +
           std::to_string(host >> 8 & 255) + '.' + std::to_string(host & 255) + ':' +
           std::to_string(port);
  }

  bool operator==(const Address& o) const { return host == o.host && port == o.port; }
  bool operator<(const Address& o) const {
    return std::tie(host, port) < std::tie(o.host, o.port);
  }
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_IO_ADDRESS_HPP
