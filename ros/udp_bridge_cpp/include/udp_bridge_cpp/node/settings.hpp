// SPDX-License-Identifier: Apache-2.0
//
// Settings of a node as text, by the names of its ROS parameters; the Python nodes have the same.

#ifndef UDP_BRIDGE_CPP_NODE_SETTINGS_HPP
#define UDP_BRIDGE_CPP_NODE_SETTINGS_HPP

#include <netdb.h>
#include <sys/socket.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <stdexcept>
#include <string>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/wire/address.hpp"

namespace udp_bridge_cpp {

/// A setting is invalid; the text begins with its name.
struct BadSetting : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Settings as a user writes them.
struct Settings {
  std::string bind = "127.0.0.1:7511";  ///< address to receive at
  std::string peer;                     ///< the only sender to accept; port 0: any of that host
  std::string allow_any_peer = "false";
  std::string key_file, key_env;
  std::string datagram = "loopback";  ///< largest datagram of sent messages
  std::string repair = "none";        ///< repair of sent messages: none, resend or resend SECONDS
  std::string trace;
  std::string frame_prefix;

  /// Call `visit(name, value)` for each setting.
  template <class Visit>
  void each(Visit&& visit) {
    visit("bind", bind);
    visit("peer", peer);
    visit("allow_any_peer", allow_any_peer);
    visit("key_file", key_file);
    visit("key_env", key_env);
    visit("datagram", datagram);
    visit("repair", repair);
    visit("trace", trace);
    visit("frame_prefix", frame_prefix);
  }
};

/// Settings that were checked.
struct CheckedSettings {
  Address bind;
  std::optional<Address> peer;
  std::size_t datagram = udp_bridge::kLoopback;
  std::int64_t resend_nanos = 0;  ///< how long sent messages may be requested again; 0: never

  /// Check all settings; throw BadSetting.
  explicit CheckedSettings(const Settings& given)
      : bind(address_of(given.bind, "bind")),
        datagram(datagram_of(given.datagram)),
        resend_nanos(resend_nanos_of(given.repair)) {
    if (!given.peer.empty()) peer = address_of(given.peer, "peer");
    if (!given.key_file.empty() || !given.key_env.empty()) refuse("key_file and key_env");
    if (!given.trace.empty()) refuse("trace");
    if (!given.frame_prefix.empty()) refuse("frame_prefix");
    if (flag_of(given.allow_any_peer, "allow_any_peer")) refuse("allow_any_peer");
    if (!bind.is_loopback() && !peer) {
      throw BadSetting("bind is '" + given.bind +
                       "', which other hosts can reach. Fix: set ~peer to the gateway's HOST:PORT "
                       "(port 0: any port)");
    }
  }

 private:
  [[noreturn]] static void refuse(const std::string& name) {
    throw BadSetting(name + ": only the Python nodes have it. Fix: leave it out, or start "
                            "udp_bridge_ros1 or udp_bridge_ros2");
  }

  /// Read HOST:PORT and resolve the host.
  static Address address_of(const std::string& text, const std::string& what) {
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
    Address address = Address::of(*reinterpret_cast<const sockaddr_in*>(found->ai_addr));
    freeaddrinfo(found);
    address.port = static_cast<std::uint16_t>(std::stoul(port));
    return address;
  }

  static bool flag_of(std::string text, const std::string& what) {
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    if (text == "1") text = "true";  // a boolean parameter of ROS as text
    if (text == "0") text = "false";
    if (text != "true" && text != "false") {
      throw BadSetting(what + " is '" + text + "'; expected true or false");
    }
    return text == "true";
  }

  static std::size_t datagram_of(const std::string& text) {
    if (text == "loopback") return udp_bridge::kLoopback;
    if (text == "mtu") return udp_bridge::kMtu;
    char* end = nullptr;
    const unsigned long size = std::strtoul(text.c_str(), &end, 10);
    if (text.empty() || *end || size < 256 || size > udp_bridge::kLargestDatagram) {
      throw BadSetting("datagram is '" + text + "'; expected mtu, loopback or 256 to 65507");
    }
    return size;
  }

  static std::int64_t resend_nanos_of(const std::string& text) {
    if (text.empty() || text == "none") return 0;
    if (text == "resend") return udp_bridge::kNanos / 2;
    if (text.rfind("resend ", 0) == 0) {
      char* end = nullptr;
      const double seconds = std::strtod(text.c_str() + 7, &end);
      if (!*end && seconds >= 0.001 && seconds <= 60) {
        return static_cast<std::int64_t>(std::ceil(seconds * udp_bridge::kNanos));
      }
    }
    throw BadSetting("repair is '" + text +
                     "'; expected none, resend or `resend SECONDS` (only the Python nodes have "
                     "fec)");
  }
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_SETTINGS_HPP
