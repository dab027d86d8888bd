// SPDX-License-Identifier: Apache-2.0
//
// From the bridge to ROS: a bounded queue for each topic, and the thread that publishes.
//
// Slow operations of ROS (a new publisher, a large body, a stalled subscriber) happen behind the
// queues. They cost queued messages, which are counted, and no datagrams.

#ifndef UDP_BRIDGE_CPP_NODE_PUBLISH_QUEUE_HPP
#define UDP_BRIDGE_CPP_NODE_PUBLISH_QUEUE_HPP

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <queue>
#include <string>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/io/clock.hpp"
#include "udp_bridge_cpp/node/publish_channel.hpp"
#include "udp_bridge_cpp/node/publish_result.hpp"
#include "udp_bridge_cpp/node/ros.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_cpp {

/// Publishes messages on a thread of its own.
class PublishQueue {
 public:
  /// Publishers at most, so that a hostile sender can't fill the ROS graph.
  static constexpr std::size_t kMaxPublishers = 256;
  /// A topic without messages for so long may lose its slot to another topic.
  static constexpr std::int64_t kIdleNanos = 10 * udp_bridge::kNanos;
  /// Time at the end for messages that wait.
  static constexpr std::int64_t kEndNanos = 5 * udp_bridge::kNanos;

  /// `on_result` is called once for each message, by `put` or by the publishing thread.
  PublishQueue(Ros& ros, std::function<void(PublishResult&&)> on_result)
      : ros_(ros), on_result_(std::move(on_result)), thread_([this] { run(); }) {}

  ~PublishQueue() { close(); }

  /// Queue a message of a ROS type; the oldest of a full queue is dropped. Never blocks for long.
  void put(Received&& received) {
    const std::lock_guard lock(mutex_);
    const std::shared_ptr<PublishChannel> channel = channel_of(received);
    if (!channel) return;
    channel->append(std::move(received));
    if (channel->is_full()) {
      const Received oldest = channel->pop();
      ++superseded_;
      on_result_({oldest.message, oldest.sender, false});
    } else {
      push([this, channel] { publish_next(channel); });
    }
  }

  /// Have the publisher of a message's topic created; return whether it is new.
  bool prepare(const udp_bridge::Message& message, const Address& sender) {
    const std::lock_guard lock(mutex_);
    const std::shared_ptr<PublishChannel> channel = find_or_create(message).channel;
    if (!channel || channel->is_prepared || !channel->refused_as.empty()) return false;
    channel->is_prepared = true;
    push([this, channel, header = message.header, sender] { advertise(*channel, header, sender); });
    return true;
  }

  /// Publish messages in their order, then call `then` on the publishing thread.
  void put_all(std::vector<Received>&& messages, std::function<void()> then) {
    const std::lock_guard lock(mutex_);
    push([this, batch = std::make_shared<std::vector<Received>>(std::move(messages)),
          then = std::move(then)] {
      for (const Received& received : *batch) {
        std::unique_lock inner(mutex_);
        const std::shared_ptr<PublishChannel> channel = channel_of(received);
        inner.unlock();
        if (channel) publish(*channel, received);
      }
      then();
    });
  }

  /// Return whether the bridge publishes a topic.
  bool publishes(const std::string& topic) const {
    const std::lock_guard lock(mutex_);
    return std::any_of(channels_.begin(), channels_.end(),
                       [&](const auto& entry) { return entry.second->topic == topic; });
  }

  /// Publish what waits, for some seconds at most, and end the thread.
  void close() {
    {
      const std::lock_guard lock(mutex_);
      if (!thread_.joinable()) return;
      end_nanos_ = steady_nanos() + kEndNanos;
    }
    condition_.notify_one();
    thread_.join();
  }

  std::uint64_t published() const { return locked(published_); }
  /// Messages that a newer message of their topic displaced.
  std::uint64_t superseded() const { return locked(superseded_); }
  /// Messages that ROS can't take.
  std::uint64_t refused() const {
    const std::lock_guard lock(mutex_);
    std::uint64_t sum = 0;
    for (const auto& [reason, count] : refusals_) sum += count;
    return sum;
  }
  /// The same by reason: type_name, type_not_installed, no_publisher, no_slot, not_cdr and
  /// not_published.
  std::map<std::string, std::uint64_t> refusals() const { return locked(refusals_); }

 private:
  using Key = std::tuple<std::uint8_t, std::string, std::string>;
  using Task = std::function<void()>;

  /// Where a message is published, or why it is not.
  struct Destination {
    std::shared_ptr<PublishChannel> channel;  // nullptr where there can be none
    std::size_t offset = 0;                   // where the CDR begins in the body
    std::string refused_as;
  };

  template <class T>
  T locked(const T& value) const {
    const std::lock_guard lock(mutex_);
    return value;
  }

  void push(Task&& task) {
    tasks_.push(std::move(task));
    condition_.notify_one();
  }

  void run() {
    std::unique_lock lock(mutex_);
    while (true) {
      condition_.wait(lock, [&] { return !tasks_.empty() || end_nanos_; });
      if (tasks_.empty() || (end_nanos_ && steady_nanos() > end_nanos_)) return;
      const Task task = std::move(tasks_.front());
      tasks_.pop();
      lock.unlock();
      task();
      lock.lock();
    }
  }

  /// Return the channel of a message; nullptr where it was refused and counted.
  std::shared_ptr<PublishChannel> channel_of(const Received& received) {
    Destination destination = find_or_create(received.message);
    const Bytes& body = received.message.body;
    const std::size_t at = destination.offset;
    const bool is_cdr = body.size() >= at + 2 && body[at] == 0 && body[at + 1] == 1;
    if (destination.refused_as.empty() && !is_cdr) {
      destination.refused_as = "not_cdr";  // any other body would break subscribers
    }
    if (destination.refused_as.empty()) return destination.channel;
    refuse(destination.refused_as, received);
    return nullptr;
  }

  Destination find_or_create(const udp_bridge::Message& message) {
    const MessageType& row = *message_type(message.header.msg_type);
    udp_bridge::Typed typed;
    if (row.number != udp_bridge::kTyped) {
      typed.ros_type = row.ros_type;
    } else if (!udp_bridge::Typed::parse(message.body.data(), message.body.size(), typed)) {
      return {nullptr, 0, "type_name"};
    }
    const std::string& named = message.header.topic;
    Key key{row.number, typed.ros_type, named.empty() ? std::string(row.default_topic) : named};
    auto found = channels_.find(key);
    if (found == channels_.end()) {
      if (channels_.size() >= kMaxPublishers && !has_freed_slot()) {
        return {nullptr, 0, "no_slot"};
      }
      auto channel = std::make_shared<PublishChannel>(row, std::get<1>(key), std::get<2>(key));
      found = channels_.emplace(std::move(key), std::move(channel)).first;
    }
    found->second->used_nanos = steady_nanos();
    return {found->second, typed.offset, found->second->refused_as};
  }

  /// End the channel that was silent longest; return whether there is one that may end.
  bool has_freed_slot() {
    const auto silent = std::min_element(
        channels_.begin(), channels_.end(),
        [](const auto& a, const auto& b) { return a.second->used_nanos < b.second->used_nanos; });
    if (steady_nanos() - silent->second->used_nanos < kIdleNanos) return false;
    push([this, channel = silent->second] {
      channel->publisher.reset();
      ros_.info(channel->topic + ": no longer published: replaced by another topic");
    });
    silent->second->refused_as = "no_slot";  // for messages that are still queued
    channels_.erase(silent);
    return true;
  }

  void publish_next(const std::shared_ptr<PublishChannel>& channel) {
    std::unique_lock lock(mutex_);
    const Received received = channel->pop();
    lock.unlock();
    publish(*channel, received);
  }

  /// Publish a message; the lock is not held.
  void publish(PublishChannel& channel, const Received& received) {
    const udp_bridge::Message& message = received.message;
    if (!channel.publisher) advertise(channel, message.header, received.sender);
    bool is_new = true;
    std::string reason = locked(channel.refused_as);
    if (reason.empty()) {
      try {
        is_new = !channel.qos.is_repeated || channel.is_new(received);
        const std::size_t offset = offset_of(message);
        if (is_new) {
          channel.publisher->publish(message.body.data() + offset, message.body.size() - offset);
        }
      } catch (const std::exception& error) {
        warn(channel, error);
        reason = "not_published";
      }
    }
    const std::lock_guard lock(mutex_);
    if (!reason.empty()) return refuse(reason, received);
    published_ += is_new;
    on_result_({message, received.sender, true});
  }

  static std::size_t offset_of(const udp_bridge::Message& message) {
    udp_bridge::Typed typed;
    if (message.header.msg_type == udp_bridge::kTyped) {
      udp_bridge::Typed::parse(message.body.data(), message.body.size(), typed);
    }
    return typed.offset;
  }

  /// Create the publisher of a channel, or note why there can be none; the lock is not held.
  void advertise(PublishChannel& channel, const udp_bridge::Header& header, const Address& sender) {
    if (channel.publisher || !locked(channel.refused_as).empty()) return;
    std::string reason;
    try {
      channel.publisher = ros_.advertise(channel.ros_type, channel.topic, channel.row, channel.qos);
      ros_.info(channel.topic + ": " + channel.ros_type + " from " + sender.text() +
                (header.link.empty() ? "" : ", frame " + header.link));
      const std::lock_guard lock(mutex_);
      channel.is_prepared = true;
      return;
    } catch (const TypeNotInstalled& error) {
      warn(channel, error);
      reason = "type_not_installed";
    } catch (const std::exception& error) {
      warn(channel, error);
      reason = "no_publisher";
    }
    const std::lock_guard lock(mutex_);
    channel.refused_as = reason;
  }

  void warn(PublishChannel& channel, const std::exception& error) {
    if (channel.has_warned) return;
    channel.has_warned = true;
    ros_.warn(channel.topic + ": " + channel.ros_type + " can't be published: " + error.what());
  }

  void refuse(const std::string& reason, const Received& received) {
    ++refusals_[reason];
    on_result_({received.message, received.sender, false});
  }

  Ros& ros_;
  const std::function<void(PublishResult&&)> on_result_;
  mutable std::mutex mutex_;  // guards all below and the queues of the channels
  std::condition_variable condition_;
  std::queue<Task> tasks_;
  std::map<Key, std::shared_ptr<PublishChannel>> channels_;
  std::map<std::string, std::uint64_t> refusals_;
  std::uint64_t published_ = 0, superseded_ = 0;
  std::int64_t end_nanos_ = 0;  // 0 until `close`
  std::thread thread_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_NODE_PUBLISH_QUEUE_HPP
