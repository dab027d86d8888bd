// SPDX-License-Identifier: Apache-2.0
//
// An IPv4 address with its port.

#ifndef UDP_BRIDGE_CPP_ADDRESS_HPP
#define UDP_BRIDGE_CPP_ADDRESS_HPP

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <tuple>

#include "udp_bridge.hpp"

namespace udp_bridge_cpp {

/// A setting is invalid; the text begins with its name.
struct BadSetting : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The source or destination of datagrams.
struct Address {
  std::uint32_t host = 0;  ///< in host byte order
  std::uint16_t port = 0;

  /// Read HOST:PORT and resolve the host; throw BadSetting, which names the setting `what`.
  static Address parse(const std::string& text, const std::string& what) {
    const std::size_t colon = text.rfind(':');
    const std::string port = colon == std::string::npos ? "" : text.substr(colon + 1);
    const bool is_number = !port.empty() && port.size() <= 5 &&
                           std::all_of(port.begin(), port.end(),
                                       [](char c) { return c >= '0' && c <= '9'; });
    if (!is_number || !colon || std::stoul(port) > 0xFFFF) {
      throw BadSetting(what + " is '" + text + "'; expected HOST:PORT such as 127.0.0.1:7511");
    }
    addrinfo hints{};
    hints.ai_family = AF_INET;
    hints.ai_socktype = SOCK_DGRAM;
    addrinfo* found = nullptr;
    const std::string host = text.substr(0, colon);
    if (const int error = getaddrinfo(host.c_str(), nullptr, &hints, &found); error != 0) {
      throw BadSetting(what + " is '" + text + "': " + gai_strerror(error));
    }
    Address address = of(*reinterpret_cast<const sockaddr_in*>(found->ai_addr));
    freeaddrinfo(found);
    address.port = static_cast<std::uint16_t>(std::stoul(port));
    return address;
  }

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

  /// The same as one number.
  udp_bridge::SenderId id() const { return udp_bridge::SenderId{host} << 16 | port; }
  static Address of_id(udp_bridge::SenderId id) {
    return {static_cast<std::uint32_t>(id >> 16), static_cast<std::uint16_t>(id)};
  }

  /// Whether only this host reaches it.
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

#endif  // UDP_BRIDGE_CPP_ADDRESS_HPP
