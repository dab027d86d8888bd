// SPDX-License-Identifier: Apache-2.0
//
// An owned file descriptor.

#ifndef UDP_BRIDGE_CPP_IO_DESCRIPTOR_HPP
#define UDP_BRIDGE_CPP_IO_DESCRIPTOR_HPP

#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace udp_bridge_cpp {

/// A file descriptor, closed at the end.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {
    if (number < 0) throw std::system_error(errno, std::generic_category());
  }
  ~Descriptor() { ::close(number_); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int number() const { return number_; }

 private:
  int number_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_IO_DESCRIPTOR_HPP
