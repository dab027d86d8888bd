// SPDX-License-Identifier: Apache-2.0
//
// The bridge's end in a ROS graph, for either ROS: three threads and the queues between them.
//
//   SocketThread -- datagrams --> ProcessingThread -- messages --> PublishQueue --> ROS
//   SocketThread <-- datagrams -- ProcessingThread <-- messages -- callbacks of ROS

#ifndef UDP_BRIDGE_CPP_NODE_BRIDGE_NODE_HPP
#define UDP_BRIDGE_CPP_NODE_BRIDGE_NODE_HPP

#include <cstdint>
#include <string>

#include "udp_bridge_cpp/io/signal.hpp"
#include "udp_bridge_cpp/io/socket_thread.hpp"
#include "udp_bridge_cpp/node/processing_thread.hpp"
#include "udp_bridge_cpp/node/ros.hpp"
#include "udp_bridge_cpp/node/settings.hpp"

namespace udp_bridge_cpp {

/// One end of a bridge, from the constructor until `close`.
class BridgeNode {
 public:
  /// Throws BadSetting where a setting is invalid, std::system_error where the address is taken.
  BridgeNode(Ros& ros, const Settings& settings)
      : settings_(settings),
        ros_(ros),
        socket_(settings_.bind, settings_.peer, [this] { signal_.notify(); }),
        processing_(ros, socket_, signal_, settings_) {
    ros.info("receiving at " + socket_.address().text());
    if (socket_.receive_buffer() < kSmallBuffer) {
      ros.warn("the receive buffer is small, so large messages may be lost. Fix: sysctl -w "
               "net.core.rmem_max=" + std::to_string(SocketThread::kReceiveBuffer));
    }
  }

  /// End all threads; return the totals.
  std::string close() {
    processing_.close();
    for (const auto& [reason, count] : processing_.refusals()) {
      ros_.info("not published: " + reason + ' ' + std::to_string(count));
    }
    return processing_.totals();
  }

 private:
  static constexpr std::uint32_t kSmallBuffer = 4 << 20;

  const CheckedSettings settings_;
  Ros& ros_;
  Signal signal_;
  SocketThread socket_;
  ProcessingThread processing_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_BRIDGE_NODE_HPP
