// SPDX-License-Identifier: Apache-2.0
//
// Queue of datagrams between the socket thread and the processing thread.

#ifndef UDP_BRIDGE_CPP_IO_DATAGRAM_QUEUE_HPP
#define UDP_BRIDGE_CPP_IO_DATAGRAM_QUEUE_HPP

#include <cstddef>

#include "udp_bridge_cpp/io/bounded_queue.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_cpp {

/// A datagram with the address of its sender or receiver.
struct Datagram {
  Bytes bytes;
  Address address;
};

/// The memory that a datagram takes in a queue.
struct DatagramCost {
  std::size_t operator()(const Datagram& datagram) const { return datagram.bytes.size() + 256; }
};
using DatagramQueue = BoundedQueue<Datagram, DatagramCost>;

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_IO_DATAGRAM_QUEUE_HPP
