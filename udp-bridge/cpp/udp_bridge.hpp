// SPDX-License-Identifier: Apache-2.0
//
// UDP Bridge, version 1, for C++17: datagrams in, whole messages out, and the way back.
//
// The rules are those of ../PROTOCOL.md, sections 1 to 8; repair (types 65 and 66) and sealed
// datagrams (type 68) are refused and counted, as PROTOCOL.md allows. (The nodes of
// ros/udp_bridge_cpp send and answer Requests for lost parts, type 65.)
// Bytes and time are arguments: nothing here opens a socket, reads a clock or starts a thread, so
// that it serves a node, a microcontroller and a fuzzer alike. Needs the standard library alone.
// It validates no addresses (section 11): beyond the own host, give it datagrams of known peers alone.
//
//   udp_bridge::Receiver receiver;
//   receiver.take(data, size, sender, now_nanos,
//                 [](const udp_bridge::Message& m) { publish(m.topic, m.body); },
//                 [](const std::uint8_t* datagram, std::size_t n) { send_back(datagram, n); });
//   receiver.report(now_nanos, wall_nanos, send_to);  // once a second, and three times at the end
//
//   udp_bridge::Sender sender;
//   sender.send(9, "/cmd_vel", "", stamp_nanos, cdr, size, udp_bridge::kMtu,
//               [](const std::uint8_t* head, std::size_t h, const std::uint8_t* part,
//                  std::size_t p) { sendmsg_of_both(head, h, part, p); });

#ifndef UDP_BRIDGE_HPP
#define UDP_BRIDGE_HPP

#include <algorithm>
#include <array>
#include <bitset>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <deque>
#include <limits>
#include <list>
#include <map>
#include <set>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace udp_bridge {

constexpr std::int64_t kNanos = 1000000000;
constexpr std::size_t kFixedSize = 18;
constexpr std::size_t kLargestDatagram = 65507;

/// Presets of the size of datagrams; any other from 256 to 65507 bytes will do as well.
constexpr std::size_t kMtu = 1472;
constexpr std::size_t kLoopback = 0;

/// Bytes of a body in each part of the preset `loopback`.
constexpr std::size_t kLoopbackPart = 65280;

constexpr std::uint8_t kSubscribe = 7;
constexpr std::uint8_t kControl = 64;
constexpr std::uint8_t kTyped = 67;
constexpr std::uint8_t kSealed = 68;

/// Why a datagram is refused, by the names of PROTOCOL.md, section 7.
enum class Refusal {
  none,
  empty,
  short_,
  header_size_small,
  header_size_past_end,
  header_size_unaligned,
  parts_zero,
  part_past_parts,
  nsec_negative,
  nsec_too_big,
  topic_past_header,
  link_past_header,
  header_size_large,
  topic_not_utf8,
  topic_nul,
  link_not_utf8,
  link_nul,
  unknown_type,
  sealed,
  part_size,
  parts_max,
  link,
  body_size,
  body_value,
  count_
};

inline const char* name_of(Refusal refusal) {
  static constexpr std::array<const char*, static_cast<std::size_t>(Refusal::count_)> names = {
      "none",           "empty",         "short",
      "header_size_small", "header_size_past_end", "header_size_unaligned",
      "parts_zero",     "part_past_parts", "nsec_negative",
      "nsec_too_big",   "topic_past_header", "link_past_header",
      "header_size_large", "topic_not_utf8", "topic_nul",
      "link_not_utf8",  "link_nul",      "unknown_type",
      "sealed",         "part_size",     "parts_max",
      "link",           "body_size",     "body_value"};
  return names[static_cast<std::size_t>(refusal)];
}

// Generated from wire/types.py by `python -m tools.wire_types`.
/// Whether a message of this type has a ROS type: its body is CDR.
inline bool has_ros_type(std::uint8_t type) {
  switch (type) {
    case 1: case 2: case 3: case 4: case 5: case 6: case 8: case 9: case 10: case 11: case 32:
    case 33: case 34: case 35: case 36: case 37: case 38: case 39: case 40: case 67:
      return true;
    default:
      return false;
  }
}

/// Whether PROTOCOL.md, section 4, has this type.
inline bool is_in_table(std::uint8_t type) {
  switch (type) {
    case 1: case 2: case 3: case 4: case 5: case 6: case 7: case 8: case 9: case 10: case 11:
    case 32: case 33: case 34: case 35: case 36: case 37: case 38: case 39: case 40: case 64:
    case 65: case 66: case 67:
      return true;
    default:
      return false;
  }
}

/// Whether a message older than the newest one of its topic is dropped as stale.
inline bool is_stamp_ordered(std::uint8_t type) {
  switch (type) {
    case 2: case 5: case 9: case 36: case 38:
      return true;
    default:
      return false;
  }
}
// End of the generated part.

namespace detail {

inline std::uint32_t read_u32(const std::uint8_t* at) {
  return std::uint32_t{at[0]} | std::uint32_t{at[1]} << 8 | std::uint32_t{at[2]} << 16 |
         std::uint32_t{at[3]} << 24;
}

inline void write_u32(std::uint8_t* at, std::uint32_t value) {
  for (int i = 0; i < 4; ++i) at[i] = static_cast<std::uint8_t>(value >> 8 * i);
}

inline std::uint64_t read_u64(const std::uint8_t* at) {
  return read_u32(at) | std::uint64_t{read_u32(at + 4)} << 32;
}

inline void write_u64(std::uint8_t* at, std::uint64_t value) {
  for (int i = 0; i < 8; ++i) at[i] = static_cast<std::uint8_t>(value >> 8 * i);
}

/// UTF-8 as RFC 3629 has it: no surrogates, nothing longer than it needs to be.
inline bool is_utf8(const std::uint8_t* text, std::size_t size) {
  for (std::size_t i = 0; i < size;) {
    const std::uint8_t lead = text[i];
    std::size_t more = 0;
    std::uint8_t low = 0x80, high = 0xBF;
    if (lead < 0x80) {
      ++i;
      continue;
    }
    if (lead >= 0xC2 && lead <= 0xDF) {
      more = 1;
    } else if (lead >= 0xE0 && lead <= 0xEF) {
      more = 2;
      if (lead == 0xE0) low = 0xA0;
      if (lead == 0xED) high = 0x9F;
    } else if (lead >= 0xF0 && lead <= 0xF4) {
      more = 3;
      if (lead == 0xF0) low = 0x90;
      if (lead == 0xF4) high = 0x8F;
    } else {
      return false;
    }
    if (size - i <= more) return false;
    if (text[i + 1] < low || text[i + 1] > high) return false;
    for (std::size_t k = 2; k <= more; ++k) {
      if ((text[i + k] & 0xC0) != 0x80) return false;
    }
    i += more + 1;
  }
  return true;
}

}  // namespace detail

/// The header of a datagram, PROTOCOL.md, section 2.
struct Header {
  std::uint8_t msg_type = 0;
  std::uint32_t seq_number = 0;
  std::uint8_t part_number = 0;
  std::uint8_t parts_max = 1;
  std::int32_t time_sec = 0;
  std::int32_t time_nsec = 0;
  std::string topic;
  std::string link;

  std::int64_t stamp_nanos() const { return std::int64_t{time_sec} * kNanos + time_nsec; }

  /// Set the stamp; return false where it is beyond the years 1901 to 2038 of the wire.
  bool set_stamp(std::int64_t nanos) {
    const std::int64_t nsec = (nanos % kNanos + kNanos) % kNanos;
    const std::int64_t sec = (nanos - nsec) / kNanos;
    time_nsec = static_cast<std::int32_t>(nsec);
    time_sec = static_cast<std::int32_t>(sec);
    return time_sec == sec;
  }

  /// Bytes of the header with its padding.
  std::size_t size() const {
    return (kFixedSize + topic.size() + link.size() + 3) / 4 * 4;
  }

  /// Whether it can be sent: its names are text and fit, its fields are in their ranges.
  bool is_legal() const {
    const auto text = [](const std::string& name) {
      return detail::is_utf8(reinterpret_cast<const std::uint8_t*>(name.data()), name.size()) &&
             name.find('\0') == std::string::npos;
    };
    return topic.size() + link.size() <= 234 && part_number < parts_max && time_nsec >= 0 &&
           time_nsec < kNanos && text(topic) && text(link);
  }

  /// Write `size()` bytes.
  void pack(std::uint8_t* at) const {
    const std::size_t whole = size();
    at[0] = msg_type;
    at[1] = static_cast<std::uint8_t>(whole);
    detail::write_u32(at + 2, seq_number);
    at[6] = part_number;
    at[7] = parts_max;
    detail::write_u32(at + 8, static_cast<std::uint32_t>(time_sec));
    detail::write_u32(at + 12, static_cast<std::uint32_t>(time_nsec));
    at[16] = static_cast<std::uint8_t>(topic.size());
    at[17] = static_cast<std::uint8_t>(link.size());
    std::copy(topic.begin(), topic.end(), at + kFixedSize);
    std::copy(link.begin(), link.end(), at + kFixedSize + topic.size());
    std::fill(at + kFixedSize + topic.size() + link.size(), at + whole, std::uint8_t{0});
  }

  /// Read a datagram's header; its body begins at the second byte count. Tests in the order of
  /// PROTOCOL.md, section 7.
  static Refusal parse(const std::uint8_t* data, std::size_t size, Header& to,
                       std::size_t& header_size) {
    if (size < kFixedSize) return size ? Refusal::short_ : Refusal::empty;
    header_size = data[1];
    if (header_size < 20) return Refusal::header_size_small;
    if (header_size > size) return Refusal::header_size_past_end;
    if (header_size % 4) return Refusal::header_size_unaligned;
    to.msg_type = data[0];
    to.seq_number = detail::read_u32(data + 2);
    to.part_number = data[6];
    to.parts_max = data[7];
    if (!to.parts_max) return Refusal::parts_zero;
    if (to.part_number >= to.parts_max) return Refusal::part_past_parts;
    to.time_sec = static_cast<std::int32_t>(detail::read_u32(data + 8));
    to.time_nsec = static_cast<std::int32_t>(detail::read_u32(data + 12));
    if (to.time_nsec < 0) return Refusal::nsec_negative;
    if (to.time_nsec >= kNanos) return Refusal::nsec_too_big;
    const std::size_t topic_end = kFixedSize + data[16], link_end = topic_end + data[17];
    if (topic_end > header_size) return Refusal::topic_past_header;
    if (link_end > header_size) return Refusal::link_past_header;
    if (header_size - link_end > 3) return Refusal::header_size_large;
    const std::uint8_t *topic_at = data + kFixedSize, *link_at = data + topic_end;
    if (!detail::is_utf8(topic_at, data[16])) return Refusal::topic_not_utf8;
    if (std::memchr(topic_at, 0, data[16])) return Refusal::topic_nul;
    if (!detail::is_utf8(link_at, data[17])) return Refusal::link_not_utf8;
    if (std::memchr(link_at, 0, data[17])) return Refusal::link_nul;
    to.topic.assign(reinterpret_cast<const char*>(topic_at), data[16]);
    to.link.assign(reinterpret_cast<const char*>(link_at), data[17]);
    if (to.msg_type == kSealed) return Refusal::sealed;
    if (!has_ros_type(to.msg_type) && to.msg_type != kSubscribe && to.msg_type != kControl) {
      return Refusal::unknown_type;
    }
    return Refusal::none;
  }
};

/// A whole message. The body of a type with a ROS type is CDR.
struct Message {
  Header header;  ///< of its part 0, whichever part came last
  std::vector<std::uint8_t> body;
  std::uint64_t count = 0;  ///< which count of its topic it belongs to; for `Receiver::settle`
};

/// What became of a message that was handed over.
enum class Outcome {
  published,
  dropped,   ///< the user cannot take it
  deferred,  ///< not known yet: the user calls `Receiver::settle` when it is
};

/// Type 67: a message of the ROS type that the body names, PROTOCOL.md, section 4.1.
struct Typed {
  std::string ros_type;    ///< full ROS 2 type name, such as sensor_msgs/msg/MagneticField
  std::size_t offset = 0;  ///< where the CDR begins in the body, a multiple of 8

  /// Return the body of a message; empty where `ros_type` is not package/msg/Name.
  static std::vector<std::uint8_t> pack(const std::string& ros_type, const std::uint8_t* cdr,
                                        std::size_t size) {
    if (!is_name(ros_type)) return {};
    std::vector<std::uint8_t> body((1 + ros_type.size() + 7) / 8 * 8);
    body[0] = static_cast<std::uint8_t>(ros_type.size());
    std::copy(ros_type.begin(), ros_type.end(), body.begin() + 1);
    body.insert(body.end(), cdr, cdr + size);
    return body;
  }

  /// Read the beginning of a body; return false where a receiver drops it as `type_name`.
  static bool parse(const std::uint8_t* body, std::size_t size, Typed& to) {
    if (!size) return false;
    to.offset = (std::size_t{body[0]} + 8) / 8 * 8;
    if (to.offset > size) return false;
    to.ros_type.assign(reinterpret_cast<const char*>(body + 1), body[0]);
    return is_name(to.ros_type);
  }

 private:
  /// Whether a text matches [a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]* and has at most 255 bytes.
  static bool is_name(const std::string& text) {
    const auto is_lower = [](char c) { return c >= 'a' && c <= 'z'; };
    const auto is_upper = [](char c) { return c >= 'A' && c <= 'Z'; };
    const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
    const std::size_t slash = text.find('/');
    if (text.size() > 255 || slash == std::string::npos || text.compare(slash, 5, "/msg/")) {
      return false;
    }
    const std::string package = text.substr(0, slash), name = text.substr(slash + 5);
    return !package.empty() && is_lower(package[0]) && !name.empty() && is_upper(name[0]) &&
           std::all_of(package.begin(), package.end(),
                       [&](char c) { return is_lower(c) || is_digit(c) || c == '_'; }) &&
           std::all_of(name.begin(), name.end(),
                       [&](char c) { return is_lower(c) || is_upper(c) || is_digit(c); });
  }
};

/// Type 7: a request of the topic that the header names.
struct Subscribe {
  std::uint8_t wanted_type = 0;
  bool wanted = true;
  std::uint16_t lease_s = 0;  ///< 0: until unsubscribed
  float max_rate_hz = 0;      ///< 0: all

  std::array<std::uint8_t, 8> pack() const {
    std::array<std::uint8_t, 8> body{};
    body[0] = wanted_type;
    body[1] = wanted;
    body[2] = static_cast<std::uint8_t>(lease_s);
    body[3] = static_cast<std::uint8_t>(lease_s >> 8);
    std::uint32_t bits = 0;
    std::memcpy(&bits, &max_rate_hz, 4);
    detail::write_u32(body.data() + 4, bits);
    return body;
  }

  static Refusal parse(const std::uint8_t* body, std::size_t size, Subscribe& to) {
    if (size != 8) return Refusal::body_size;
    const std::uint32_t bits = detail::read_u32(body + 4);
    std::memcpy(&to.max_rate_hz, &bits, 4);
    to.wanted_type = body[0];
    to.wanted = body[1] == 1;
    to.lease_s = static_cast<std::uint16_t>(body[2] | body[3] << 8);
    const bool is_rate = std::isfinite(to.max_rate_hz) && to.max_rate_hz >= 0;
    if (!has_ros_type(to.wanted_type) || body[1] > 1 || !is_rate) return Refusal::body_value;
    return Refusal::none;
  }
};

/// Control, kind 0: a datagram has left the receive buffer or was lost, PROTOCOL.md, section 6.
struct Credit {
  std::uint8_t msg_type = 0;  ///< of the acknowledged datagram, like the next two
  std::uint8_t part_number = 0;
  std::uint32_t seq_number = 0;
  std::uint32_t receive_buffer = 0;  ///< SO_RCVBUF read back

  std::array<std::uint8_t, 12> pack() const {
    std::array<std::uint8_t, 12> body{};
    body[1] = msg_type;
    body[2] = part_number;
    detail::write_u32(body.data() + 4, seq_number);
    detail::write_u32(body.data() + 8, receive_buffer);
    return body;
  }

  static Refusal parse(const std::uint8_t* body, std::size_t size, Credit& to) {
    if (size != 12) return Refusal::body_size;
    to = {body[1], body[2], detail::read_u32(body + 4), detail::read_u32(body + 8)};
    return is_in_table(to.msg_type) ? Refusal::none : Refusal::body_value;
  }
};

/// Control, kind 1: delivery counts of a topic, PROTOCOL.md, section 6.
struct TopicReport {
  static constexpr std::size_t kSize = 128;
  /// The ages where no message was published within the last 10 s.
  static constexpr std::int64_t kNoAge = std::numeric_limits<std::int64_t>::min();

  std::uint8_t msg_type = 0;
  std::uint32_t first_number = 0;
  std::int64_t since_nanos = 0;
  std::uint64_t numbers = 0, published = 0, dropped = 0, incomplete = 0, late = 0, pending = 0;
  std::uint64_t repaired = 0, duplicates = 0, body_bytes = 0;
  std::int64_t first_seen_stamp_nanos = 0, first_stamp_nanos = 0, last_stamp_nanos = 0;
  std::int64_t age_p50_nanos = kNoAge, age_p99_nanos = kNoAge;

  std::array<std::uint8_t, kSize> pack() const {
    std::array<std::uint8_t, kSize> body{};
    body[0] = 1;
    body[1] = msg_type;
    detail::write_u32(body.data() + 4, first_number);
    std::uint8_t* at = write(body.data() + 8, since_nanos);
    for (const std::uint64_t value : {numbers, published, dropped, incomplete, late, pending,
                                      repaired, duplicates, body_bytes}) {
      at = write(at, value);
    }
    for (const std::int64_t value : {first_seen_stamp_nanos, first_stamp_nanos, last_stamp_nanos,
                                     age_p50_nanos, age_p99_nanos}) {
      at = write(at, value);
    }
    return body;
  }

  static Refusal parse(const std::uint8_t* body, std::size_t size, TopicReport& to) {
    if (size != kSize) return Refusal::body_size;
    to.msg_type = body[1];
    to.first_number = detail::read_u32(body + 4);
    const std::uint8_t* at = read(body + 8, to.since_nanos);
    for (std::uint64_t* value : {&to.numbers, &to.published, &to.dropped, &to.incomplete, &to.late,
                                 &to.pending, &to.repaired, &to.duplicates, &to.body_bytes}) {
      at = read(at, *value);
    }
    for (std::int64_t* value : {&to.first_seen_stamp_nanos, &to.first_stamp_nanos,
                                &to.last_stamp_nanos, &to.age_p50_nanos, &to.age_p99_nanos}) {
      at = read(at, *value);
    }
    std::uint64_t left = to.numbers;  // no sum, which may overflow
    for (const std::uint64_t count :
         {to.published, to.dropped, to.incomplete, to.late, to.pending}) {
      if (count > left) return Refusal::body_value;
      left -= count;
    }
    return is_in_table(to.msg_type) ? Refusal::none : Refusal::body_value;
  }

 private:
  template <class Number>
  static std::uint8_t* write(std::uint8_t* at, Number value) {
    detail::write_u64(at, static_cast<std::uint64_t>(value));
    return at + 8;
  }
  template <class Number>
  static const std::uint8_t* read(const std::uint8_t* at, Number& value) {
    value = static_cast<Number>(detail::read_u64(at));
    return at + 8;
  }
};

namespace detail {

/// Check the body of Control, kind 2, PROTOCOL.md, section 6.
inline Refusal check_link_report(const std::uint8_t* body, std::size_t size) {
  constexpr std::size_t fixed = 40, reason = 9, most_reasons = 32, longest_name = 32;
  if (size < fixed) return Refusal::body_size;
  std::size_t at = fixed;
  for (std::size_t i = 0; i < most_reasons && at < size; ++i) {
    if (size - at < reason) return Refusal::body_size;
    const std::size_t name = body[at + reason - 1];
    at += reason;
    if (size - at < name) return Refusal::body_size;
    const bool is_name = std::all_of(body + at, body + at + name, [](std::uint8_t c) {
      return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
    });
    if (!is_name || !name || name > longest_name) return Refusal::body_value;
    at += name;
  }
  return at == size ? Refusal::none : Refusal::body_size;
}

/// Results of the newest 1024 messages of a topic, each counted once.
class DeliveryLog {
 public:
  std::uint32_t first_number = 0;  ///< lowest number seen and remembered
  std::uint64_t numbers = 0;       ///< from the first to the highest one seen, both included
  std::uint64_t published = 0, dropped = 0, incomplete = 0, late = 0;

  /// Messages of which a part arrived and that have no result yet.
  std::uint64_t pending() const { return (came_ & ~settled_).count(); }

  /// Note that a part of a message came.
  void seen(std::uint32_t number) {
    if (!numbers) {
      first_number = highest_ = number;
      numbers = 1;
      came_.set(0);
      return;
    }
    if (number == highest_) return;
    const std::uint32_t ahead = number - highest_;
    if (ahead >= 1u << 31) {
      const std::uint32_t behind = highest_ - number;
      if (behind >= kRemembered) return;
      if (behind >= numbers) {
        first_number = number;
        numbers = std::uint64_t{behind} + 1;
      }
      came_.set(behind);
      return;
    }
    came_ <<= ahead;
    came_.set(0);
    settled_ <<= ahead;
    highest_ = number;
    numbers += ahead;
  }

  /// Count the result of a message; return false where it has one, or is too old.
  bool settle(std::uint32_t number, std::uint64_t DeliveryLog::*count) {
    seen(number);
    const std::uint32_t behind = highest_ - number;
    if (behind >= kRemembered || settled_.test(behind)) return false;
    settled_.set(behind);
    ++(this->*count);
    return true;
  }

 private:
  static constexpr std::uint32_t kRemembered = 1024;
  std::uint32_t highest_ = 0;
  std::bitset<kRemembered> came_, settled_;  // bit 0 is the highest number's
};

/// Arrivals of one topic until its sender restarts, and what the user took.
struct Arrivals {
  static constexpr std::size_t kAgesKept = 1024;
  static constexpr std::int64_t kAgesNanos = 10 * kNanos;

  DeliveryLog log;
  std::uint64_t body_bytes = 0, repaired = 0;
  std::int64_t first_seen_stamp = 0, first_stamp = 0, last_stamp = 0, since = 0;
  bool has_since = false;  // the first report gives it
  std::uint64_t id = 0;    // of this count, among all of the receiver
  std::deque<std::pair<std::int64_t, std::int64_t>> published;  // when, and the stamp

  void seen(const Header& header) {
    if (!log.numbers) first_seen_stamp = header.stamp_nanos();
    log.seen(header.seq_number);
  }

  void handed(std::uint32_t number, std::int64_t stamp, std::size_t size, bool is_taken,
              std::int64_t now) {
    if (!log.settle(number, is_taken ? &DeliveryLog::published : &DeliveryLog::dropped) || !is_taken) return;
    if (log.published == 1) first_stamp = stamp;
    last_stamp = stamp;
    body_bytes += size;
    published.emplace_back(now, stamp);
    if (published.size() > kAgesKept) published.pop_front();
  }

  TopicReport report(std::uint8_t type, std::uint64_t duplicates, std::int64_t now,
                     std::int64_t wall) {
    if (!has_since) since = wall;
    has_since = true;
    while (!published.empty() && now - published.front().first > kAgesNanos) published.pop_front();
    std::vector<std::int64_t> ages;
    for (const auto& [at, stamp] : published) ages.push_back(wall - (now - at) - stamp);
    std::sort(ages.begin(), ages.end());
    const auto percentile = [&](std::size_t percent) {
      return ages.empty() ? TopicReport::kNoAge : ages[(ages.size() * percent + 99) / 100 - 1];
    };
    TopicReport report;
    report.msg_type = type;
    report.first_number = log.first_number;
    report.since_nanos = since;
    report.numbers = log.numbers;
    report.published = log.published;
    report.dropped = log.dropped;
    report.incomplete = log.incomplete;
    report.late = log.late;
    report.pending = log.pending();
    report.repaired = repaired;
    report.duplicates = duplicates;
    report.body_bytes = body_bytes;
    report.first_seen_stamp_nanos = first_seen_stamp;
    report.first_stamp_nanos = first_stamp;
    report.last_stamp_nanos = last_stamp;
    report.age_p50_nanos = percentile(50);
    report.age_p99_nanos = percentile(99);
    return report;
  }
};

}  // namespace detail

/// What a receiver spends at most: guards against peers that err or attack.
struct Limits {
  std::size_t memory_bytes = 64u << 20;  ///< announced by all open messages
  std::size_t open_per_topic = 4;
  std::size_t senders = 64;
  std::size_t topics = 1024;
  std::int64_t time_limit_nanos = 2 * kNanos;  ///< from a message's first part to its last
  std::uint32_t receive_buffer = 212992;       ///< SO_RCVBUF read back, sent in every Credit
};

struct Counters {
  std::array<std::uint64_t, static_cast<std::size_t>(Refusal::count_)> refused{};
  std::uint64_t messages = 0, incomplete = 0, late = 0, missing = 0, duplicates = 0;
};

/// Whoever a datagram came from, such as an IPv4 address and a port in one number.
using SenderId = std::uint64_t;

/// Joins the datagrams of any number of senders into messages, and gives Credit for them.
class Receiver {
 public:
  explicit Receiver(Limits limits = {}) : limits_(limits) {}

  /// Take one datagram.
  ///
  /// `hand_over(Message&&)` is called for each message that is whole now, `reply(data, size)` for a
  /// Credit that is due to the sender. `now_nanos` is of any clock that never goes back. Where
  /// `hand_over` returns bool, false means that the user can't take the message: it is reported as
  /// dropped instead of published. Where it returns an Outcome, that is reported.
  template <class HandOver, class Reply>
  void take(const std::uint8_t* data, std::size_t size, SenderId from, std::int64_t now_nanos,
            HandOver&& hand_over, Reply&& reply) {
    std::size_t offset = 0;
    Refusal refusal = Header::parse(data, size, scratch_, offset);
    if (refusal == Refusal::none) {
      expire(now_nanos);
      refusal = accept(scratch_, data + offset, size - offset, size, from, now_nanos, hand_over,
                       reply);
    }
    if (refusal != Refusal::none) ++counters.refused[static_cast<std::size_t>(refusal)];
  }

  /// Report what became of a message whose Outcome was deferred, whenever and once that is known.
  ///
  /// `header` and `count` are the message's, `size` is that of its body.
  void settle(SenderId from, const Header& header, std::uint64_t count, std::size_t size,
              bool is_published, std::int64_t now_nanos) {
    const auto peer = peers_.find(from);
    if (peer == peers_.end()) return;
    const auto topic = peer->second.topics.find({header.msg_type, header.topic});
    if (topic == peer->second.topics.end() || topic->second.arrivals.id != count) return;
    topic->second.arrivals.handed(header.seq_number, header.stamp_nanos(), size, is_published,
                                  now_nanos);
  }

  /// From now on hand over messages of a topic also behind newer ones: its sender offers to resend
  /// (PROTOCOL.md, section 9.2), and the user sends the Requests. The user also judges restarts.
  void offer(SenderId from, std::uint8_t msg_type, const std::string& topic,
             std::int64_t now_nanos) {
    topic_of(peer_of(from, now_nanos), {msg_type, topic}).is_offered = true;
  }

  /// Whether the message that a header names, of a given type, was handed over, late or given up.
  bool is_finished(SenderId from, std::uint8_t msg_type, const Header& header) const {
    const auto peer = peers_.find(from);
    if (peer == peers_.end()) return false;
    const auto topic = peer->second.topics.find({msg_type, header.topic});
    return topic != peer->second.topics.end() &&
           topic->second.is_finished({header.seq_number, header.stamp_nanos()});
  }

  /// Note that a message of an offered topic was requested: it counts as repaired.
  void requested(SenderId from, std::uint8_t msg_type, const std::string& topic,
                 std::uint32_t number, std::int64_t now_nanos) {
    std::set<std::uint32_t>& numbers =
        topic_of(peer_of(from, now_nanos), {msg_type, topic}).requested;
    numbers.insert(number);
    if (numbers.size() > kMostRequested) numbers.erase(numbers.begin());
  }

  /// Begin an offered topic anew: its sender was restarted.
  void restart(SenderId from, std::uint8_t msg_type, const std::string& topic,
               std::int64_t now_nanos) {
    forget(topic_of(peer_of(from, now_nanos), {msg_type, topic}), kNever);
  }

  /// Tell the senders that were heard within the last 5 s what became of their messages: one
  /// TopicReport for each topic. Call it once a second, and three times at the end.
  ///
  /// `now_nanos` is of the clock of `take`, `wall_nanos` the wall clock since the POSIX epoch.
  /// `send(sender, data, size)` is called for each datagram.
  template <class Send>
  void report(std::int64_t now_nanos, std::int64_t wall_nanos, Send&& send) {
    expire(now_nanos);
    for (auto& [from, peer] : peers_) {
      if (now_nanos - peer.heard_nanos > kReportedNanos) continue;
      for (auto& [name, topic] : peer.topics) {
        Header header = control_header(peer, wall_nanos, name.second);
        header.link = topic.link;
        const auto body =
            topic.arrivals.report(name.first, topic.duplicates, now_nanos, wall_nanos).pack();
        send_control(header, body, [&, to = from](const std::uint8_t* data, std::size_t size) {
          send(to, data, size);
        });
      }
    }
  }

  /// Send a LinkReport, whose body the user packs, to the senders that `report` reports to.
  template <class Body, class Send>
  void report_link(std::int64_t now_nanos, std::int64_t wall_nanos, const Body& body, Send&& send) {
    for (auto& [from, peer] : peers_) {
      if (now_nanos - peer.heard_nanos > kReportedNanos) continue;
      Header header = control_header(peer, wall_nanos, "");
      std::vector<std::uint8_t> datagram(header.size());
      header.pack(datagram.data());
      datagram.insert(datagram.end(), body.begin(), body.end());
      send(from, datagram.data(), datagram.size());
    }
  }

  /// From now on answer the AddressChallenges of a peer: one that messages are sent to, Subscribe
  /// included (PROTOCOL.md, section 11). Challenges of others are ignored.
  void answer_challenges_of(SenderId peer) { challengers_.insert(peer); }

  /// Give up the messages whose time is over; call it now and then while nothing comes.
  void expire(std::int64_t now_nanos) {
    while (!oldest_.empty() &&
           oldest_.front()->since_nanos <= now_nanos - limits_.time_limit_nanos) {
      give_up(*oldest_.front());
    }
  }

  /// Count every open message as incomplete, as at an end.
  void give_up_all() {
    while (!oldest_.empty()) give_up(*oldest_.front());
  }

  /// Announced size of all open messages.
  std::size_t memory_bytes() const { return memory_bytes_; }

  Counters counters;

 private:
  struct Key {
    std::uint32_t seq_number;
    std::int64_t stamp_nanos;
    bool operator==(const Key& o) const {
      return seq_number == o.seq_number && stamp_nanos == o.stamp_nanos;
    }
  };
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
  static constexpr std::uint8_t kAddressChallenge = 8, kAddressResponse = 9;  // kinds of Control
  static constexpr std::size_t kOpenOffered = 16, kMostRequested = 64;
  static constexpr std::int64_t kReportedNanos = 5 * kNanos;  // behind a sender's last datagram

  struct Topic;
  struct Peer;
  struct Open {  // a message of which parts are missing
    Header header;
    Key key{};
    std::int64_t since_nanos = 0;
    std::size_t part_size = 0;             // 0: not known
    std::vector<std::uint8_t> body;        // up to the last part that is in, once part_size is known
    std::vector<std::uint8_t> last;        // the last part, where it came before all others
    std::array<std::uint64_t, 4> has{};
    std::size_t parts = 0, last_size = 0, announced = 0;
    Peer* peer = nullptr;
    Topic* topic = nullptr;
    std::list<Open*>::iterator by_age;  // its place in oldest_

    bool came(std::size_t part) const { return has[part / 64] >> part % 64 & 1; }
  };
  struct Topic {
    bool has_handed = false;
    std::uint32_t last_seq = 0;
    std::int64_t last_stamp = 0, last_handed_nanos = 0;
    std::deque<Key> finished;
    std::list<Open> open;
    std::uint64_t heard = 0, duplicates = 0;
    std::string link;  // the one last seen
    detail::Arrivals arrivals;
    bool is_offered = false;            // its sender resends what is requested
    std::set<std::uint32_t> requested;  // messages of an offered topic
    bool has_suspect = false;
    std::uint32_t suspect_seq = 0;  // the last number that jumped, or was of a stale message

    /// Whether a number is too far from the last one to be believed alone (RFC 3550, A.1).
    bool is_jump(const Key& key) const {
      const std::int32_t ahead = ahead_by(key.seq_number);
      if (is_offered) return ahead >= 3000;
      return ahead >= 3000 || (ahead < -100 && key.stamp_nanos <= last_stamp);
    }
    /// Whether a message is older than the newest one, where stamps order a topic.
    bool is_stale(std::uint8_t msg_type, const Key& key) const {
      const std::int64_t older_by = last_stamp - key.stamp_nanos;
      if (is_offered) return false;
      return has_handed && is_stamp_ordered(msg_type) && older_by > 0 && older_by <= 2 * kNanos;
    }
    bool is_second(std::uint32_t seq) const { return has_suspect && seq == suspect_seq + 1; }
    /// Remember a number that is not believed; return whether it is another than before.
    bool suspect(std::uint32_t seq) {
      const bool is_new = !has_suspect || seq != suspect_seq;
      has_suspect = true;
      suspect_seq = seq;
      return is_new;
    }

    bool is_finished(const Key& key) const {
      return std::find(finished.begin(), finished.end(), key) != finished.end();
    }
    void finish(const Key& key) {
      if (is_finished(key)) return;
      finished.push_back(key);
      if (finished.size() > 64) finished.pop_front();
    }
    std::int32_t ahead_by(std::uint32_t seq) const {
      return has_handed ? static_cast<std::int32_t>(seq - last_seq) : 1;
    }
    bool is_restart_by_silence(const Header& h, std::int64_t now_nanos) const {
      return has_handed && !is_offered && h.seq_number < 256 &&
             now_nanos - last_handed_nanos >= kNanos && ahead_by(h.seq_number) <= 0;
    }
  };
  using TopicName = std::pair<std::uint8_t, std::string>;
  struct Peer {
    std::map<TopicName, Topic> topics;
    std::size_t memory_bytes = 0, uncredited_bytes = 0;
    std::uint32_t controls = 0;
    std::uint64_t heard = 0;
    std::int64_t heard_nanos = 0;
  };

  template <class HandOver, class Reply>
  Refusal accept(const Header& h, const std::uint8_t* part, std::size_t size,
                 std::size_t datagram_size, SenderId from, std::int64_t now_nanos,
                 HandOver&& hand_over, Reply&& reply) {
    if (h.parts_max > 1 && !size) return Refusal::part_size;
    if (h.msg_type == kControl) return control(h, part, size, from, now_nanos, reply);
    Subscribe ignored;
    if (h.msg_type == kSubscribe) {
      if (h.parts_max != 1) return Refusal::parts_max;
      const Refusal refusal = Subscribe::parse(part, size, ignored);
      if (refusal != Refusal::none) return refusal;
    }
    const Key key{h.seq_number, h.stamp_nanos()};
    const TopicName name{h.msg_type, h.topic};
    if (const Refusal refusal = check(from, name, key, h, size, now_nanos);
        refusal != Refusal::none) {
      return refusal;
    }
    Peer& peer = peer_of(from, now_nanos);
    Topic& topic = topic_of(peer, name);
    if (topic.is_restart_by_silence(h, now_nanos)) forget(topic, kNever);
    if (topic.is_finished(key)) {
      ++counters.duplicates;
      ++topic.duplicates;
      credit(peer, h, datagram_size, h.part_number + 1 == h.parts_max, reply);
      return Refusal::none;
    }
    auto open = find(topic, key);
    if (open == topic.open.end() && topic.is_jump(key)) {
      if (!topic.is_second(h.seq_number)) {
        const bool is_new = topic.suspect(h.seq_number);
        counters.late += is_new;
        credit(peer, h, datagram_size, is_new || h.part_number + 1 == h.parts_max, reply);
        return Refusal::none;
      }
      const std::int32_t ahead = topic.ahead_by(h.seq_number);
      counters.missing += static_cast<std::uint64_t>(std::max(0, ahead - 1));
      forget(topic, kNever);
    }
    topic.link = h.link;
    topic.arrivals.seen(h);
    if (h.parts_max == 1 && open == topic.open.end()) {
      Message message{h, {part, part + size}};
      finish(topic, key, std::move(message), now_nanos, hand_over);
      return Refusal::none;
    }
    if (open == topic.open.end()) open = begin(peer, topic, key, h, now_nanos);
    if (open->came(h.part_number)) {
      ++counters.duplicates;
      ++topic.duplicates;
      credit(peer, h, datagram_size, h.part_number + 1 == h.parts_max, reply);
      return Refusal::none;
    }
    const Refusal refusal = place(*open, h.part_number, part, size);
    announce(*open);
    const bool is_whole = open->parts == h.parts_max;
    const bool is_last = h.part_number + 1 == h.parts_max;
    if (is_whole) {
      Message message{std::move(open->header), std::move(open->body)};
      message.body.resize(open->part_size * (h.parts_max - 1u) + open->last_size);
      message.header.part_number = 0;
      release(*open);
      finish(topic, key, std::move(message), now_nanos, hand_over);
    } else {
      keep_bounds(peer, open->announced);
    }
    credit(peer, h, datagram_size, is_whole || is_last, reply);
    return refusal;
  }

  /// Refuse a part that contradicts its message, before it changes anything.
  Refusal check(SenderId from, const TopicName& name, const Key& key, const Header& h,
                std::size_t size, std::int64_t now_nanos) {
    const auto peer = peers_.find(from);
    if (peer == peers_.end()) return Refusal::none;
    const auto topic = peer->second.topics.find(name);
    if (topic == peer->second.topics.end()) return Refusal::none;
    if (topic->second.is_restart_by_silence(h, now_nanos)) return Refusal::none;
    const auto open = find(topic->second, key);
    if (open == topic->second.open.end()) return Refusal::none;
    if (open->header.parts_max != h.parts_max) return Refusal::parts_max;
    if (open->header.link != h.link) return Refusal::link;
    if (open->came(h.part_number) || !open->part_size) return Refusal::none;
    const bool is_last = h.part_number + 1 == h.parts_max;
    const bool fits = size <= open->part_size && (size == open->part_size || is_last);
    return fits ? Refusal::none : Refusal::part_size;
  }

  static std::list<Open>::iterator find(Topic& topic, const Key& key) {
    return std::find_if(topic.open.begin(), topic.open.end(),
                        [&](const Open& open) { return open.key == key; });
  }

  std::list<Open>::iterator begin(Peer& peer, Topic& topic, const Key& key, const Header& h,
                                  std::int64_t now_nanos) {
    const std::size_t most = topic.is_offered ? kOpenOffered : limits_.open_per_topic;
    while (topic.open.size() >= most) {
      give_up(topic.open.front());
    }
    Open& open = topic.open.emplace_back();
    open.header = h;
    open.key = key;
    open.since_nanos = now_nanos;
    open.peer = &peer;
    open.topic = &topic;
    open.by_age = oldest_.insert(oldest_.end(), &open);
    return std::prev(topic.open.end());
  }

  /// Put a part where it belongs; the first one that is not the last fixes the part size.
  static Refusal place(Open& open, std::size_t number, const std::uint8_t* part,
                       std::size_t size) {
    const std::size_t parts_max = open.header.parts_max;
    const bool is_last = number + 1 == parts_max;
    open.has[number / 64] |= std::uint64_t{1} << number % 64;
    ++open.parts;
    if (is_last) open.last_size = size;
    if (!open.part_size) {
      if (is_last) {  // kept aside until another one says how large parts are
        open.last.assign(part, part + size);
        return Refusal::none;
      }
      open.part_size = size;
      open.body.reserve(size * parts_max);
      const std::vector<std::uint8_t> last = std::move(open.last);
      open.last.clear();
      if (last.size() > size) {  // a right one may still come
        open.has[(parts_max - 1) / 64] &= ~(std::uint64_t{1} << (parts_max - 1) % 64);
        --open.parts;
        put(open.body, number * size, part, size);
        return Refusal::part_size;
      }
      if (!last.empty()) put(open.body, (parts_max - 1) * size, last.data(), last.size());
    }
    put(open.body, number * open.part_size, part, size);
    return Refusal::none;
  }

  /// Write a part into a body, which grows to hold it: what comes in order is written once.
  static void put(std::vector<std::uint8_t>& body, std::size_t at, const std::uint8_t* part,
                  std::size_t size) {
    if (body.size() < at) body.resize(at);
    const std::size_t within = std::min(size, body.size() - at);
    std::copy(part, part + within, body.data() + at);
    body.insert(body.end(), part + within, part + size);
  }

  template <class HandOver>
  void finish(Topic& topic, const Key& key, Message&& message, std::int64_t now_nanos,
              HandOver&& hand_over) {
    topic.finish(key);
    const std::int32_t ahead = topic.ahead_by(key.seq_number);
    topic.arrivals.repaired += topic.requested.erase(key.seq_number);
    if (ahead <= 0 && topic.is_offered) {
      if (counters.missing) --counters.missing;
      return pass(topic, key, std::move(message), now_nanos, hand_over);
    }
    const bool is_stale = ahead > 0 && topic.is_stale(message.header.msg_type, key) &&
                          !topic.is_second(key.seq_number);
    if (is_stale) topic.suspect(key.seq_number);
    if (ahead <= 0 || is_stale) {
      if (is_stale || key.stamp_nanos <= topic.last_stamp) {
        ++counters.late;
        topic.arrivals.log.settle(key.seq_number, &detail::DeliveryLog::late);
        return;
      }
      forget(topic, key.stamp_nanos);
      topic.arrivals.seen(message.header);
      topic.finish(key);
    } else {
      counters.missing += static_cast<std::uint64_t>(ahead - 1);
    }
    topic.has_handed = true;
    topic.last_seq = key.seq_number;
    topic.last_stamp = key.stamp_nanos;
    topic.last_handed_nanos = now_nanos;
    topic.has_suspect = false;
    pass(topic, key, std::move(message), now_nanos, hand_over);
  }

  /// Hand a message over, and count what becomes of it.
  template <class HandOver>
  void pass(Topic& topic, const Key& key, Message&& message, std::int64_t now_nanos,
            HandOver&& hand_over) {
    ++counters.messages;
    const std::size_t size = message.body.size();
    message.count = topic.arrivals.id;
    const Outcome outcome = outcome_of(hand_over, std::move(message));
    if (outcome == Outcome::deferred) return;
    topic.arrivals.handed(key.seq_number, key.stamp_nanos, size, outcome == Outcome::published,
                          now_nanos);
  }

  template <class HandOver>
  static Outcome outcome_of(HandOver&& hand_over, Message&& message) {
    using Result = std::invoke_result_t<HandOver&, Message&&>;
    if constexpr (std::is_same_v<Result, Outcome>) {
      return hand_over(std::move(message));
    } else if constexpr (std::is_same_v<Result, bool>) {
      return hand_over(std::move(message)) ? Outcome::published : Outcome::dropped;
    } else {
      hand_over(std::move(message));
      return Outcome::published;
    }
  }

  /// Begin a topic anew, as for a sender never heard of; open messages older than a stamp go.
  void forget(Topic& topic, std::int64_t before_nanos) {
    for (auto open = topic.open.begin(); open != topic.open.end();) {
      const auto next = std::next(open);
      if (open->key.stamp_nanos < before_nanos) give_up(*open);
      open = next;
    }
    topic.has_handed = topic.has_suspect = false;
    topic.finished.clear();
    topic.requested.clear();
    topic.arrivals = {};
    topic.arrivals.id = ++counts_;
  }

  void announce(Open& open) {
    const std::size_t size = open.part_size ? open.part_size : open.last_size;
    const std::size_t announced = size * open.header.parts_max;
    const std::size_t before = std::exchange(open.announced, announced);
    open.peer->memory_bytes += announced - before;
    memory_bytes_ += announced - before;
  }

  /// Let the oldest of a sender go where its newest, which announced so much, is too much; who
  /// holds nothing else to give takes from the one who holds the most.
  void keep_bounds(Peer& peer, std::size_t announced) {
    while (peer.memory_bytes > limits_.memory_bytes / 4) give_up_oldest(peer);
    while (memory_bytes_ > limits_.memory_bytes) {
      if (peer.memory_bytes > announced) {
        give_up_oldest(peer);
        continue;
      }
      const auto most = std::max_element(
          peers_.begin(), peers_.end(),
          [](const auto& a, const auto& b) { return a.second.memory_bytes < b.second.memory_bytes; });
      give_up_oldest(most->second);
    }
  }

  void give_up_oldest(Peer& peer) {
    give_up(**std::find_if(oldest_.begin(), oldest_.end(),
                           [&](const Open* open) { return open->peer == &peer; }));
  }

  void give_up(Open& open) {
    open.topic->finish(open.key);
    ++counters.incomplete;
    open.topic->arrivals.log.settle(open.key.seq_number, &detail::DeliveryLog::incomplete);
    release(open);
  }

  void release(Open& gone) {
    gone.peer->memory_bytes -= gone.announced;
    memory_bytes_ -= gone.announced;
    oldest_.erase(gone.by_age);
    gone.topic->open.remove_if([&](const Open& open) { return &open == &gone; });
  }

  Peer& peer_of(SenderId from, std::int64_t now_nanos) {
    if (peers_.size() >= limits_.senders && !peers_.count(from)) {
      const auto silent = std::min_element(
          peers_.begin(), peers_.end(),
          [](const auto& a, const auto& b) { return a.second.heard < b.second.heard; });
      while (!silent->second.topics.empty()) forget_topic(silent->second);
      peers_.erase(silent);
    }
    Peer& peer = peers_[from];
    peer.heard = ++heard_;
    peer.heard_nanos = now_nanos;
    return peer;
  }

  Topic& topic_of(Peer& peer, const TopicName& name) {
    if (topics_ >= limits_.topics && !peer.topics.count(name)) {
      Peer* loser = &peer;  // its own oldest; a newcomer takes from the one who holds the most
      if (peer.topics.empty()) {
        loser = &std::max_element(peers_.begin(), peers_.end(),
                                  [](const auto& a, const auto& b) {
                                    return a.second.topics.size() < b.second.topics.size();
                                  })
                     ->second;
      }
      forget_topic(*loser);
    }
    const auto [at, is_new] = peer.topics.try_emplace(name);
    topics_ += is_new;
    if (is_new) at->second.arrivals.id = ++counts_;
    at->second.heard = ++heard_;
    return at->second;
  }

  void forget_topic(Peer& peer) {
    const auto oldest = std::min_element(
        peer.topics.begin(), peer.topics.end(),
        [](const auto& a, const auto& b) { return a.second.heard < b.second.heard; });
    while (!oldest->second.open.empty()) {
      give_up(oldest->second.open.front());
    }
    peer.topics.erase(oldest);
    --topics_;
  }

  /// Of Control CreditRequest asks something of a receiver, and AddressChallenge of a sender.
  template <class Reply>
  Refusal control(const Header& h, const std::uint8_t* part, std::size_t size, SenderId from,
                  std::int64_t now_nanos, Reply&& reply) {
    if (h.parts_max != 1) return Refusal::parts_max;
    if (!size) return Refusal::body_size;
    Credit credited;
    TopicReport report;
    switch (part[0]) {
      case 0: return Credit::parse(part, size, credited);
      case 1: return TopicReport::parse(part, size, report);
      case 2: return detail::check_link_report(part, size);
      case 3:
        if (size != 4) return Refusal::body_size;
        credit(peer_of(from, now_nanos), h, size, true, reply);
        return Refusal::none;
      case kAddressChallenge:
      case kAddressResponse: {
        std::array<std::uint8_t, 16> response{};
        if (size != response.size()) return Refusal::body_size;
        if (part[0] == kAddressResponse || !challengers_.count(from)) return Refusal::none;
        std::copy(part, part + size, response.begin());
        response[0] = kAddressResponse;
        send_control(control_header(peer_of(from, now_nanos), 0, ""), response, reply);
        return Refusal::none;
      }
      default: return Refusal::body_value;
    }
  }

  /// Acknowledge a datagram where that is due, or an eighth of the buffer was taken since the last.
  template <class Reply>
  void credit(Peer& peer, const Header& h, std::size_t datagram_size, bool is_due, Reply&& reply) {
    if (h.parts_max == 1 && h.msg_type != kControl) return;
    peer.uncredited_bytes += datagram_size + 1024 + (datagram_size <= 16384 ? datagram_size : 0);
    if (!is_due && peer.uncredited_bytes <= limits_.receive_buffer / 8) return;
    peer.uncredited_bytes = 0;
    const Credit report{h.msg_type, h.part_number, h.seq_number, limits_.receive_buffer};
    send_control(control_header(peer, h.stamp_nanos(), h.topic), report.pack(), reply);
  }

  static Header control_header(Peer& peer, std::int64_t stamp_nanos, const std::string& topic) {
    Header header;
    header.msg_type = kControl;
    header.seq_number = peer.controls++;
    header.set_stamp(stamp_nanos);
    header.topic = topic;
    return header;
  }

  template <std::size_t Size, class Send>
  static void send_control(const Header& header, const std::array<std::uint8_t, Size>& body,
                           Send&& send) {
    std::array<std::uint8_t, 256 + Size> datagram{};
    header.pack(datagram.data());
    std::copy(body.begin(), body.end(), datagram.data() + header.size());
    send(datagram.data(), header.size() + Size);
  }

  Limits limits_;
  std::map<SenderId, Peer> peers_;
  std::list<Open*> oldest_;  // open messages of all senders, oldest first
  std::set<SenderId> challengers_;
  std::size_t memory_bytes_ = 0, topics_ = 0;
  std::uint64_t heard_ = 0, counts_ = 0;
  Header scratch_;
};

/// Cuts messages into datagrams and numbers them.
class Sender {
 public:
  /// Send one message; return false, having sent nothing, where it cannot be sent.
  ///
  /// `emit(header, header_size, part, part_size)` is called for each datagram, in order; the two
  /// are sent as one. `largest` bounds a datagram in bytes, or is a preset. A message that needs more than
  /// 255 parts is cut into larger ones, as PROTOCOL.md, section 3, has it.
  template <class Emit>
  bool send(std::uint8_t msg_type, const std::string& topic, const std::string& link,
            std::int64_t stamp_nanos, const std::uint8_t* body, std::size_t size,
            std::size_t largest, Emit&& emit) {
    Header header;
    header.msg_type = msg_type;
    header.topic = topic;
    header.link = link;
    if (!header.set_stamp(stamp_nanos) || !header.is_legal()) return false;
    const std::size_t part_size = part_size_of(size, header.size(), largest);
    if (!part_size) return false;
    const std::size_t parts = std::max<std::size_t>(1, (size + part_size - 1) / part_size);
    header.parts_max = static_cast<std::uint8_t>(parts);
    header.seq_number = numbers_[{msg_type, topic}]++;
    std::array<std::uint8_t, 256> packed{};
    for (std::size_t part = 0; part < parts; ++part) {
      header.part_number = static_cast<std::uint8_t>(part);
      header.pack(packed.data());
      const std::size_t begin = part * part_size;
      emit(packed.data(), header.size(), body + begin, std::min(part_size, size - begin));
    }
    return true;
  }

  /// Return how many bytes of a body a part carries; 0 where the message fits at no size.
  static std::size_t part_size_of(std::size_t size, std::size_t header_size, std::size_t largest) {
    if (largest != kLoopback && (largest < 256 || largest > kLargestDatagram)) return 0;
    const std::size_t most = kLargestDatagram - header_size;
    const std::size_t wanted =
        largest == kLoopback ? std::min(kLoopbackPart, most) : largest - header_size;
    if (size <= wanted * 255) return wanted;
    for (std::size_t datagram = kMtu; datagram < kLargestDatagram; datagram += 1480) {
      if (size <= (datagram - header_size) * 255) return datagram - header_size;
    }
    return size <= most * 255 ? most : 0;
  }

  /// The number of messages sent, modulo 2^32, by msg_type and topic.
  const std::map<std::pair<std::uint8_t, std::string>, std::uint32_t>& counts() const {
    return numbers_;
  }

 private:
  std::map<std::pair<std::uint8_t, std::string>, std::uint32_t> numbers_;
};

}  // namespace udp_bridge

#endif  // UDP_BRIDGE_HPP
