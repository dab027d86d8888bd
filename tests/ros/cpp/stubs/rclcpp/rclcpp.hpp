// SPDX-License-Identifier: Apache-2.0
//
// A stub of the part of rclcpp that the node uses, with its names and types.
//
// The graph is the program's terminal. What is published is a line of stdout, `publish TOPIC TYPE
// QOS HEX`; a log line is `log TEXT`. Lines of stdin are messages and changes of the graph:
// `message TOPIC HEX`, `publisher TOPIC TYPE`, `subscribers TOPIC COUNT` and `slow MILLISECONDS`,
// the time that each publish takes from then on.
#pragma once

#include <poll.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace rcl_interfaces::msg {
struct ParameterDescriptor {
  bool dynamic_typing = false;
};
}  // namespace rcl_interfaces::msg

struct rcutils_uint8_array_t {
  std::uint8_t* buffer;
  std::size_t buffer_length;
  std::size_t buffer_capacity;
};

namespace rclcpp {

class SerializedMessage {
 public:
  explicit SerializedMessage(std::size_t capacity)
      : bytes_(capacity), raw_{bytes_.data(), 0, capacity} {}
  rcutils_uint8_array_t& get_rcl_serialized_message() { return raw_; }
  const rcutils_uint8_array_t& get_rcl_serialized_message() const { return raw_; }

 private:
  std::vector<std::uint8_t> bytes_;
  rcutils_uint8_array_t raw_;
};

struct KeepLast {
  explicit KeepLast(std::size_t d) : depth(d) {}
  std::size_t depth;
};

enum class ReliabilityPolicy { Reliable, BestEffort };

class QoS {
 public:
  explicit QoS(const KeepLast& keep) : depth_(keep.depth) {}
  QoS& reliable() { return *this; }
  QoS& best_effort() {
    is_reliable_ = false;
    return *this;
  }
  QoS& transient_local() {
    is_latched_ = true;
    return *this;
  }
  ReliabilityPolicy reliability() const {
    return is_reliable_ ? ReliabilityPolicy::Reliable : ReliabilityPolicy::BestEffort;
  }
  std::string text() const {
    return std::to_string(depth_) + (is_reliable_ ? ",reliable" : ",best_effort") +
           (is_latched_ ? ",latched" : "");
  }

 private:
  std::size_t depth_;
  bool is_reliable_ = true, is_latched_ = false;
};

class TopicEndpointInfo {
 public:
  TopicEndpointInfo(std::string type, std::uint8_t gid) : type_(std::move(type)) { gid_[0] = gid; }
  const std::string& topic_type() const { return type_; }
  const QoS& qos_profile() const { return qos_; }
  const std::array<std::uint8_t, 24>& endpoint_gid() const { return gid_; }

 private:
  std::string type_;
  QoS qos_{KeepLast(10)};
  std::array<std::uint8_t, 24> gid_{};
};

using Callback = std::function<void(std::shared_ptr<SerializedMessage>)>;

/// The graph, as the terminal has it.
struct Graph {
  std::mutex mutex;
  std::map<std::string, std::vector<TopicEndpointInfo>> publishers;
  std::map<std::string, std::size_t> subscribers;
  std::multimap<std::string, std::shared_ptr<Callback>> subscriptions;
  std::map<std::string, std::string> parameters;
  std::atomic<int> slow_milliseconds{0};

  static Graph& of_process() {
    static Graph graph;
    return graph;
  }

  void say(const std::string& line) {
    const std::lock_guard lock(mutex);
    std::cout << line << std::endl;
  }

  void read(const std::string& line) {
    std::istringstream words(line);
    std::string verb, topic, rest;
    words >> verb >> topic >> rest;
    std::vector<std::shared_ptr<Callback>> called;
    {
      const std::lock_guard lock(mutex);
      if (verb == "publisher") {
        auto& known = publishers[topic];
        known.emplace_back(rest, static_cast<std::uint8_t>(known.size()));
      } else if (verb == "subscribers") {
        subscribers[topic] = std::stoul(rest);
      } else if (verb == "slow") {
        slow_milliseconds = std::stoi(topic);
      } else if (verb == "message") {
        for (auto [at, end] = subscriptions.equal_range(topic); at != end; ++at) {
          called.push_back(at->second);
        }
      }
    }
    for (const auto& callback : called) {
      auto message = std::make_shared<SerializedMessage>(rest.size() / 2);
      auto& raw = message->get_rcl_serialized_message();
      for (; raw.buffer_length < rest.size() / 2; ++raw.buffer_length) {
        raw.buffer[raw.buffer_length] = static_cast<std::uint8_t>(
            std::stoi(rest.substr(2 * raw.buffer_length, 2), nullptr, 16));
      }
      (*callback)(message);
    }
  }
};

class GenericPublisher {
 public:
  using SharedPtr = std::shared_ptr<GenericPublisher>;
  explicit GenericPublisher(std::string line) : line_(std::move(line)) {}
  void publish(const SerializedMessage& message) {
    std::this_thread::sleep_for(
        std::chrono::milliseconds(Graph::of_process().slow_milliseconds.load()));
    const auto& raw = message.get_rcl_serialized_message();
    std::string digits;
    for (std::size_t i = 0; i < raw.buffer_length; ++i) {
      digits += "0123456789abcdef"[raw.buffer[i] >> 4];
      digits += "0123456789abcdef"[raw.buffer[i] & 15];
    }
    Graph::of_process().say("publish " + line_ + ' ' + digits);
  }

 private:
  const std::string line_;
};

class GenericSubscription {
 public:
  using SharedPtr = std::shared_ptr<GenericSubscription>;
  GenericSubscription(const std::string& topic, Callback callback)
      : callback_(std::make_shared<Callback>(std::move(callback))) {
    const std::lock_guard lock(Graph::of_process().mutex);
    Graph::of_process().subscriptions.emplace(topic, callback_);
  }
  ~GenericSubscription() {
    Graph& graph = Graph::of_process();
    const std::lock_guard lock(graph.mutex);
    for (auto at = graph.subscriptions.begin(); at != graph.subscriptions.end();) {
      at = at->second == callback_ ? graph.subscriptions.erase(at) : std::next(at);
    }
  }

 private:
  std::shared_ptr<Callback> callback_;
};

class ParameterValue {
 public:
  explicit ParameterValue(std::string text) : text_(std::move(text)) {}
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

inline std::string to_string(const ParameterValue& value) { return value.text(); }

class Time {
 public:
  explicit Time(std::int64_t nanos) : nanos_(nanos) {}
  std::int64_t nanoseconds() const { return nanos_; }

 private:
  std::int64_t nanos_;
};

class Logger {};

inline void log(const Logger&, const char* format, ...) {
  std::array<char, 4096> line{};
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line.data(), line.size(), format, arguments);
  va_end(arguments);
  Graph::of_process().say(std::string("log ") + line.data());
}

class Node {
 public:
  using SharedPtr = std::shared_ptr<Node>;
  explicit Node(const std::string&) {}

  const ParameterValue& declare_parameter(const std::string& name, const ParameterValue& value,
                                          const rcl_interfaces::msg::ParameterDescriptor&) {
    const auto& given = Graph::of_process().parameters;
    const auto found = given.find(name);
    values_.push_back(std::make_unique<ParameterValue>(found == given.end() ? value.text()
                                                                            : found->second));
    return *values_.back();
  }
  GenericPublisher::SharedPtr create_generic_publisher(const std::string& topic,
                                                       const std::string& type, const QoS& qos) {
    if (topic.find(' ') != std::string::npos) throw std::runtime_error("invalid topic name");
    return std::make_shared<GenericPublisher>(topic + ' ' + type + ' ' + qos.text());
  }
  GenericSubscription::SharedPtr create_generic_subscription(const std::string& topic,
                                                             const std::string& type,
                                                             const QoS& qos, Callback callback) {
    auto subscription = std::make_shared<GenericSubscription>(topic, std::move(callback));
    Graph::of_process().say("subscribe " + topic + ' ' + type + ' ' + qos.text());
    return subscription;
  }
  std::vector<TopicEndpointInfo> get_publishers_info_by_topic(const std::string& topic) const {
    const std::lock_guard lock(Graph::of_process().mutex);
    return Graph::of_process().publishers[topic];
  }
  std::size_t count_publishers(const std::string& topic) const {
    return get_publishers_info_by_topic(topic).size();
  }
  std::size_t count_subscribers(const std::string& topic) const {
    const std::lock_guard lock(Graph::of_process().mutex);
    return Graph::of_process().subscribers[topic] + Graph::of_process().subscriptions.count(topic);
  }
  Logger get_logger() const { return {}; }
  Time now() const {
    return Time(std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch())
                    .count());
  }

 private:
  std::vector<std::unique_ptr<ParameterValue>> values_;
};

namespace executors {

/// Reads stdin.
class SingleThreadedExecutor {
 public:
  void add_node(const Node::SharedPtr&) {}
  void spin() {
    std::string text;
    while (!is_cancelled_) {
      pollfd ready{STDIN_FILENO, POLLIN, 0};
      if (poll(&ready, 1, 20) <= 0 || !(ready.revents & POLLIN)) continue;
      std::array<char, 65536> bytes{};
      const ssize_t size = read(STDIN_FILENO, bytes.data(), bytes.size());
      if (size <= 0) return;
      text.append(bytes.data(), static_cast<std::size_t>(size));
      for (std::size_t end; (end = text.find('\n')) != std::string::npos;) {
        Graph::of_process().read(text.substr(0, end));
        text.erase(0, end + 1);
      }
    }
  }
  void cancel() { is_cancelled_ = true; }

 private:
  std::atomic<bool> is_cancelled_{false};
};

}  // namespace executors

class InitOptions {};
enum class SignalHandlerOptions { All, SigInt, SigTerm, None };

/// Reads parameters as `-p NAME:=VALUE`.
inline void init(int count, char** words, const InitOptions&, SignalHandlerOptions) {
  for (int i = 1; i < count; ++i) {
    const std::string word = words[i];
    const std::size_t mark = word.find(":=");
    if (mark != std::string::npos) {
      Graph::of_process().parameters[word.substr(0, mark)] = word.substr(mark + 2);
    }
  }
}
inline bool ok() { return true; }
inline void shutdown() {}

}  // namespace rclcpp

#define RCLCPP_INFO(logger, ...) rclcpp::log(logger, __VA_ARGS__)
#define RCLCPP_WARN(logger, ...) rclcpp::log(logger, __VA_ARGS__)
