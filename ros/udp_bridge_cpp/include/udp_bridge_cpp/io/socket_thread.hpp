// SPDX-License-Identifier: Apache-2.0
//
// The thread that receives and sends datagrams (the paper's Algorithm 1).

#ifndef UDP_BRIDGE_CPP_IO_SOCKET_THREAD_HPP
#define UDP_BRIDGE_CPP_IO_SOCKET_THREAD_HPP

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/uio.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/io/datagram_queue.hpp"
#include "udp_bridge_cpp/io/descriptor.hpp"
#include "udp_bridge_cpp/wire/address.hpp"

namespace udp_bridge_cpp {

/// Owns the socket: pushes what arrives to the input queue, and sends what is in the output queue.
class SocketThread {
 public:
  /// Bytes of the datagrams in either queue.
  static constexpr std::size_t kWaiting = 64u << 20;
  static constexpr int kReceiveBuffer = 8 << 20;

  /// Bind, and begin. `wake` is called when datagrams are in the input queue. With a peer,
  /// datagrams of others are counted and dropped; its port 0 stands for any.
  ///
  /// Throws std::system_error where the address can't be bound.
  SocketThread(const Address& bind, const std::optional<Address>& peer, std::function<void()> wake)
      : socket_(::socket(AF_INET, SOCK_DGRAM, 0)),
        event_(::eventfd(0, EFD_NONBLOCK)),
        peer_(peer),
        input_(kWaiting, std::move(wake)),
        output_(kWaiting, [this] { wake_thread(); }) {
    const sockaddr_in address = bind.to_sockaddr();
    const auto* to = reinterpret_cast<const sockaddr*>(&address);
    if (::bind(socket_.number(), to, sizeof address) != 0) {
      throw std::system_error(errno, std::generic_category(), bind.text());
    }
    int buffer = kReceiveBuffer;
    socklen_t length = sizeof buffer;
    ::setsockopt(socket_.number(), SOL_SOCKET, SO_RCVBUF, &buffer, length);
    ::getsockopt(socket_.number(), SOL_SOCKET, SO_RCVBUF, &buffer, &length);
    receive_buffer_ = static_cast<std::uint32_t>(buffer);
    sockaddr_in bound{};
    length = sizeof bound;
    ::getsockname(socket_.number(), reinterpret_cast<sockaddr*>(&bound), &length);
    address_ = Address::of(bound);
    thread_ = std::thread([this] { run(); });
  }

  /// Send what is queued, and end the thread.
  ~SocketThread() {
    is_open_ = false;
    wake_thread();
    thread_.join();
  }

  const Address& address() const { return address_; }
  std::uint32_t receive_buffer() const { return receive_buffer_; }
  DatagramQueue& input() { return input_; }
  DatagramQueue& output() { return output_; }
  std::uint64_t strangers() const { return strangers_; }
  std::uint64_t datagrams() const { return datagrams_; }
  std::uint64_t bytes() const { return bytes_; }
  std::uint64_t kernel_drops() const { return kernel_drops_; }

 private:
  static constexpr std::size_t kMaxBatch = 256;  // received before the output gets its turn

  void run() {
    count_kernel_drops();
    while (is_open_) {
      std::array<pollfd, 2> ready{{{socket_.number(), POLLIN, 0}, {event_.number(), POLLIN, 0}}};
      ::poll(ready.data(), ready.size(), -1);
      std::uint64_t count = 0;
      if (ready[1].revents) (void)!::read(event_.number(), &count, sizeof count);
      if (ready[0].revents) receive();
      send();
    }
    send();
  }

  void receive() {
    for (std::size_t i = 0; i < kMaxBatch; ++i) {
      sockaddr_in from{};
      iovec part{buffer_.data(), buffer_.size()};
      alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(std::uint32_t))> ancillary{};
      msghdr message{};
      message.msg_name = &from;
      message.msg_namelen = sizeof from;
      message.msg_iov = &part;
      message.msg_iovlen = 1;
      message.msg_control = ancillary.data();
      message.msg_controllen = ancillary.size();
      const ssize_t size = ::recvmsg(socket_.number(), &message, MSG_DONTWAIT);
      if (size < 0 && errno == ECONNREFUSED) continue;  // of a datagram sent before
      if (size < 0) return;
      read_kernel_drops(message);
      ++datagrams_;
      bytes_ += static_cast<std::uint64_t>(size);
      const Address sender = Address::of(from);
      if (!is_accepted(sender)) {
        ++strangers_;
        continue;
      }
      input_.push({{buffer_.data(), buffer_.data() + size}, sender});
    }
  }

  void send() {
    for (const Datagram& datagram : output_.take_all()) {
      const sockaddr_in to = datagram.address.to_sockaddr();
      ::sendto(socket_.number(), datagram.bytes.data(), datagram.bytes.size(), 0,
               reinterpret_cast<const sockaddr*>(&to), sizeof to);
    }
  }

  bool is_accepted(const Address& sender) const {
    return !peer_ || (sender.host == peer_->host && (!peer_->port || sender.port == peer_->port));
  }

  void count_kernel_drops() {
    const int on = 1;
    ::setsockopt(socket_.number(), SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
  }

  void read_kernel_drops(msghdr& message) {
    for (cmsghdr* at = CMSG_FIRSTHDR(&message); at; at = CMSG_NXTHDR(&message, at)) {
      if (at->cmsg_level != SOL_SOCKET || at->cmsg_type != SO_RXQ_OVFL) continue;
      std::uint32_t count = 0;
      std::memcpy(&count, CMSG_DATA(at), sizeof count);
      kernel_drops_ = count;
    }
  }

  void wake_thread() {
    const std::uint64_t one = 1;
    (void)!::write(event_.number(), &one, sizeof one);
  }

  Descriptor socket_, event_;
  const std::optional<Address> peer_;
  Address address_;
  std::uint32_t receive_buffer_ = 0;
  DatagramQueue input_, output_;
  std::array<std::uint8_t, 65536> buffer_{};
  std::atomic<bool> is_open_{true};
  std::atomic<std::uint64_t> strangers_{0}, datagrams_{0}, bytes_{0}, kernel_drops_{0};
  std::thread thread_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_IO_SOCKET_THREAD_HPP
