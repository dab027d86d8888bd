// SPDX-License-Identifier: Apache-2.0
//
// SIGINT and SIGTERM, waited for instead of handled.

#ifndef UDP_BRIDGE_CPP_IO_TERMINATION_HPP
#define UDP_BRIDGE_CPP_IO_TERMINATION_HPP

#include <csignal>
#include <ctime>

namespace udp_bridge_cpp {

/// Blocks both signals, from the constructor on, in this thread and those that it starts. So the
/// node ends in order: what waits is published and reported before ROS shuts down.
class Termination {
 public:
  Termination() {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGINT);
    sigaddset(&signals_, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
  }

  /// Wait a tenth of a second at most; return whether a signal came.
  bool is_requested() const {
    const timespec tenth{0, 100000000};
    return sigtimedwait(&signals_, nullptr, &tenth) > 0;
  }

 private:
  sigset_t signals_{};
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_IO_TERMINATION_HPP
