// SPDX-License-Identifier: Apache-2.0
//
// The thread that processes datagrams and messages of ROS (the paper's Algorithm 2).

#ifndef UDP_BRIDGE_CPP_NODE_PROCESSING_THREAD_HPP
#define UDP_BRIDGE_CPP_NODE_PROCESSING_THREAD_HPP

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <thread>
#include <utility>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/io/bounded_queue.hpp"
#include "udp_bridge_cpp/io/clock.hpp"
#include "udp_bridge_cpp/io/signal.hpp"
#include "udp_bridge_cpp/io/socket_thread.hpp"
#include "udp_bridge_cpp/node/barrier_responder.hpp"
#include "udp_bridge_cpp/node/leased_subscriptions.hpp"
#include "udp_bridge_cpp/node/peers.hpp"
#include "udp_bridge_cpp/node/publish_queue.hpp"
#include "udp_bridge_cpp/node/ros.hpp"
#include "udp_bridge_cpp/node/ros_sample.hpp"
#include "udp_bridge_cpp/node/settings.hpp"
#include "udp_bridge_cpp/receiver/repair_requests.hpp"
#include "udp_bridge_cpp/wire/barrier.hpp"
#include "udp_bridge_cpp/wire/link_report.hpp"
#include "udp_bridge_cpp/wire/message.hpp"
#include "udp_bridge_cpp/wire/resend_bodies.hpp"

namespace udp_bridge_cpp {

/// Joins datagrams into messages and passes these on; sends messages of ROS to the peers that
/// requested them; reports, requests what was lost, and responds to Barriers.
class ProcessingThread {
 public:
  ProcessingThread(Ros& ros, SocketThread& socket, Signal& signal, const CheckedSettings& settings)
      : socket_(socket),
        signal_(signal),
        results_(kMaxResults, [this] { signal_.notify(); }),
        samples_(kMaxSamples, [this] { signal_.notify(); }),
        receiver_(limits(socket)),
        requests_(receiver_, [this](Bytes&& datagram, const Address& to) {
          socket_.output().push({std::move(datagram), to});
        }),
        peers_(socket.output(), settings.datagram),
        queue_(ros, [this](PublishResult&& result) { results_.push(std::move(result)); }),
        leases_(ros, peers_, settings.resend_nanos,
                [this](const std::string& topic) { return queue_.publishes(topic); },
                [this](TopicSample&& sample) { samples_.push(std::move(sample)); }),
        lockstep_(ros, queue_, leases_, peers_,
                  [this](const Received& received) {
                    results_.push({received.message, received.sender, false});
                  },
                  [this] { signal_.notify(); },
                  [this](TopicSample&& sample) { samples_.push(std::move(sample)); }),
        thread_([this] { run(); }) {}

  ~ProcessingThread() { close(); }

  /// End the thread; publish what waits, and report it.
  void close() {
    if (!thread_.joinable()) return;
    is_open_ = false;
    signal_.notify();
    thread_.join();
    leases_.clear();
    queue_.close();
    settle();
    for (int i = 0; i < kLastReports; ++i) report(steady_nanos());  // one may be lost
  }

  /// The totals of the node as one line; call it after `close`.
  std::string totals() const {
    std::uint64_t refused = refused_ + socket_.strangers();
    for (const std::uint64_t count : receiver_.counters.refused) refused += count;
    const std::uint64_t dropped = queue_.superseded() + queue_.refused() + unserved_ +
                                  samples_.dropped() + socket_.input().dropped() +
                                  socket_.output().dropped();
    return "published " + std::to_string(queue_.published()) + ", incomplete " +
           std::to_string(receiver_.counters.incomplete) + ", missing " +
           std::to_string(receiver_.counters.missing) + ", dropped " + std::to_string(dropped) +
           ", refused " + std::to_string(refused) + ", sent back " + std::to_string(leases_.sent());
  }

  /// Messages that ROS can't take, by reason.
  std::map<std::string, std::uint64_t> refusals() const { return queue_.refusals(); }

 private:
  static constexpr std::size_t kMaxSamples = 512;      // messages of ROS
  static constexpr std::size_t kMaxResults = 1 << 17;  // the publish queue holds fewer messages
  static constexpr std::int64_t kReportNanos = udp_bridge::kNanos;
  static constexpr std::int64_t kBarrierNanos = udp_bridge::kNanos / 50;  // between looks at ROS
  static constexpr int kLastReports = 3;

  static udp_bridge::Limits limits(const SocketThread& socket) {
    udp_bridge::Limits limits;
    limits.receive_buffer = socket.receive_buffer();
    return limits;
  }

  void run() {
    while (is_open_) {
      const std::int64_t next = turn(steady_nanos());
      signal_.wait(std::chrono::nanoseconds(std::max<std::int64_t>(0, next - steady_nanos())));
    }
  }

  /// Do all that is due; return when something else is.
  std::int64_t turn(std::int64_t now_nanos) {
    for (Datagram& datagram : socket_.input().take_all()) take(datagram);
    settle();
    for (TopicSample& taken : samples_.take_all()) {
      const std::string topic = taken.key.second;
      const ResponseLedger::Stamp stamp_nanos = taken.sample.stamp_nanos;
      leases_.offer(std::move(taken));
      lockstep_.received(topic, stamp_nanos);
    }
    std::int64_t next = now_nanos + udp_bridge::kNanos / 10;
    if (lockstep_.turn(steady_nanos())) next = now_nanos + kBarrierNanos;
    next = std::min({next, leases_.turn(now_nanos), peers_.turn(now_nanos)});
    receiver_.expire(now_nanos);
    if (now_nanos >= report_due_nanos_) {
      report_due_nanos_ = now_nanos + kReportNanos;
      report(now_nanos);
    }
    return next;
  }

  void take(const Datagram& datagram) {
    const Bytes& bytes = datagram.bytes;
    const Address& sender = datagram.address;
    const std::int64_t now_nanos = steady_nanos();
    if (is_for_node(bytes)) return take_for_node(bytes, sender, now_nanos);
    requests_.on_datagram(bytes, sender, now_nanos);
    receiver_.take(
        bytes.data(), bytes.size(), sender.id(), now_nanos,
        [&](udp_bridge::Message&& message) { return hand_over({std::move(message), sender}); },
        [&](const std::uint8_t* reply, std::size_t size) { send(reply, size, sender); });
  }

  /// Whether the node takes a datagram in place of the Receiver: Resend, or a Barrier.
  static bool is_for_node(const Bytes& bytes) {
    if (bytes.size() < udp_bridge::kFixedSize) return false;
    if (bytes[0] == kResend) return true;
    return bytes[0] == udp_bridge::kControl && bytes[1] < bytes.size() &&
           bytes[bytes[1]] == Barrier::kKind;
  }

  void take_for_node(const Bytes& bytes, const Address& sender, std::int64_t now_nanos) {
    using udp_bridge::Refusal;
    udp_bridge::Header header;
    std::size_t at = 0;
    Refusal refusal = udp_bridge::Header::parse(bytes.data(), bytes.size(), header, at);
    const bool is_resend = header.msg_type == kResend;  // a type that `Header` does not know
    if (is_resend && refusal == Refusal::unknown_type) refusal = Refusal::none;
    if (refusal == Refusal::none && header.parts_max != 1) refusal = Refusal::parts_max;
    const std::uint8_t* body = bytes.data() + at;
    if (refusal == Refusal::none) {
      refusal = is_resend ? take_resend(header, body, bytes.size() - at, sender, now_nanos)
                          : take_barrier(body, bytes.size() - at, sender);
    }
    refused_ += refusal != Refusal::none;
  }

  udp_bridge::Refusal take_resend(const udp_bridge::Header& header, const std::uint8_t* body,
                                  std::size_t size, const Address& sender,
                                  std::int64_t now_nanos) {
    ResendBody parsed;
    const udp_bridge::Refusal refusal = ResendBody::parse(body, size, parsed);
    if (refusal != udp_bridge::Refusal::none) return refusal;
    if (!parsed.is_request) {
      requests_.on_offer(header, parsed.offer, sender, now_nanos);
    } else if (PeerSender* peer = peers_.find(sender)) {
      peer->requested(header, parsed.request, now_nanos);
    }
    return refusal;
  }

  udp_bridge::Refusal take_barrier(const std::uint8_t* body, std::size_t size,
                                   const Address& sender) {
    Barrier barrier;
    const udp_bridge::Refusal refusal = Barrier::parse(body, size, barrier);
    if (refusal == udp_bridge::Refusal::none) {
      receiver_.answer_challenges_of(sender.id());
      lockstep_.take(std::move(barrier), sender);
    }
    return refusal;
  }

  /// Take a whole message.
  udp_bridge::Outcome hand_over(Received&& received) {
    using udp_bridge::Outcome;
    const udp_bridge::Header& header = received.message.header;
    if (header.msg_type == udp_bridge::kSubscribe) {
      udp_bridge::Subscribe request;
      const Bytes& body = received.message.body;
      udp_bridge::Subscribe::parse(body.data(), body.size(), request);
      receiver_.answer_challenges_of(received.sender.id());
      const bool is_served = leases_.serve(request, header.topic, received.sender);
      unserved_ += !is_served;
      return is_served ? Outcome::published : Outcome::dropped;
    }
    if (lockstep_.holds(received)) {
      lockstep_.hold(std::move(received));
    } else {
      queue_.put(std::move(received));
    }
    return Outcome::deferred;
  }

  void settle() {
    for (const PublishResult& result : results_.take_all()) {
      receiver_.settle(result.sender.id(), result.header, result.count, result.size,
                       result.is_published, result.at_nanos);
    }
  }

  void report(std::int64_t now_nanos) {
    const auto send_to = [this](udp_bridge::SenderId id, const std::uint8_t* bytes,
                                std::size_t size) { send(bytes, size, Address::of_id(id)); };
    receiver_.report(now_nanos, wall_nanos(), send_to);
    LinkReport link;
    link.receive_buffer = socket_.receive_buffer();
    link.datagrams = socket_.datagrams();
    link.bytes = socket_.bytes();
    link.kernel_drops = socket_.kernel_drops();
    link.count(receiver_.counters, socket_.strangers());
    receiver_.report_link(now_nanos, wall_nanos(), link.pack(), send_to);
  }

  void send(const std::uint8_t* bytes, std::size_t size, const Address& to) {
    socket_.output().push({Bytes(bytes, bytes + size), to});
  }

  SocketThread& socket_;
  Signal& signal_;
  BoundedQueue<PublishResult> results_;
  BoundedQueue<TopicSample> samples_;
  udp_bridge::Receiver receiver_;
  RepairRequests requests_;
  Peers peers_;
  PublishQueue queue_;
  LeasedSubscriptions leases_;
  BarrierResponder lockstep_;
  std::uint64_t refused_ = 0, unserved_ = 0;
  std::int64_t report_due_nanos_ = 0;
  std::atomic<bool> is_open_{true};
  std::thread thread_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_PROCESSING_THREAD_HPP
