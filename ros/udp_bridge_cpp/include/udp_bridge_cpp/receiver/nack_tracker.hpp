// SPDX-License-Identifier: Apache-2.0
//
// The receiver's side of Resend for one topic: which lost parts and messages to request, and when
// (PROTOCOL.md, 9.2).
//
// There is no timer: each datagram of the topic, Offers included, has due requests sent.

#ifndef UDP_BRIDGE_CPP_RECEIVER_NACK_TRACKER_HPP
#define UDP_BRIDGE_CPP_RECEIVER_NACK_TRACKER_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/receiver/round_trip.hpp"
#include "udp_bridge_cpp/wire/resend_bodies.hpp"

namespace udp_bridge_cpp {

/// A Request, with the fields of its header and how often to send it.
struct Nack {
  std::uint32_t number = 0;
  std::int64_t stamp_nanos = 0;
  Request request;
  int copies = 1;
};

/// Incomplete messages of one topic whose sender offers to resend them.
class NackTracker {
 public:
  /// What a datagram means for the receiver of the topic.
  struct Arrival {
    bool is_restart = false;   ///< the sender was restarted
    bool is_repaired = false;  ///< its message was requested, and this part completes it
  };

  /// Take an Offer: all parts of the message that the header names were sent. It may have been
  /// received before the first Offer of the topic.
  Arrival on_offer(const udp_bridge::Header& header, const Offer& offer, bool is_received,
                   std::int64_t now_nanos) {
    limit_nanos_ = std::int64_t{offer.limit_ms} * 1000000;
    const Arrival arrival{is_restart(header), false};
    if (arrival.is_restart) reset();
    const bool is_new = advance(header, now_nanos);
    const auto found = entries_.find(header.seq_number);
    if (found == entries_.end()) {
      if (is_received && !is_finished(header)) finish(header);
      if (is_new && !is_finished(header)) {
        entries_.emplace(header.seq_number, Entry(now_nanos)).first->second.due_nanos = now_nanos;
      }
      return arrival;
    }
    Entry& entry = found->second;
    if (entry.parts_max) entry.sent_to = offer.parts_max;
    // It was sent behind all that was requested before a round trip.
    if (!entry.tries || now_nanos - entry.requested_nanos >= round_trip_.wait_nanos(0)) {
      entry.due_nanos = std::min(entry.due_nanos, now_nanos);
    }
    return arrival;
  }

  /// Take a part of a message.
  Arrival on_part(const udp_bridge::Header& header, std::int64_t now_nanos) {
    Arrival arrival{is_restart(header), false};
    if (arrival.is_restart) reset();
    advance(header, now_nanos);
    if (is_finished(header)) return arrival;
    const auto found = entries_.try_emplace(header.seq_number, now_nanos).first;
    Entry& entry = found->second;
    if (entry.tries == 1 && (!entry.parts_max || header.part_number < entry.sent_to)) {
      round_trip_.add(now_nanos - entry.requested_nanos);
    }
    if (entry.stamp_nanos != header.stamp_nanos() || entry.parts_max != header.parts_max) {
      entry.received.reset();
      entry.stamp_nanos = header.stamp_nanos();
      entry.parts_max = header.parts_max;
    }
    entry.received.set(header.part_number);
    if (entry.received.count() == header.parts_max) {
      arrival.is_repaired = entry.tries > 0;
      entries_.erase(found);
      finish(header);
      return arrival;
    }
    const bool is_all_sent = header.seq_number != newest_;
    const int sent_to = is_all_sent ? header.parts_max : header.part_number;
    entry.sent_to = std::max(entry.sent_to, sent_to);
    if (!missing(entry).any()) {
      entry.due_nanos = kNever;
    } else if (entry.due_nanos == kNever) {
      entry.due_nanos = now_nanos + round_trip_.debounce_nanos();
    }
    return arrival;
  }

  /// Return the requests that are due now; the caller fills in the goodput.
  std::vector<Nack> take_due(std::uint8_t msg_type, std::int64_t now_nanos) {
    std::vector<Nack> nacks;
    for (auto at = entries_.begin(); at != entries_.end();) {
      auto& [number, entry] = *at;
      if (now_nanos - entry.since_nanos > limit_nanos_ || entry.tries >= kMaxTries) {
        at = entries_.erase(at);
        continue;
      }
      ++at;
      if (entry.due_nanos > now_nanos) continue;
      const Parts parts = missing(entry);
      if (entry.parts_max && !parts.any()) {
        entry.due_nanos = kNever;
        continue;
      }
      const int copies = std::min(1 + (entry.tries + 1) / 2, kMaxCopies);
      const std::uint8_t parts_max = parts.any() ? entry.parts_max : std::uint8_t{0};
      const std::int64_t stamp_nanos = parts_max ? entry.stamp_nanos : 0;
      const bool joins = !parts_max && !nacks.empty() && !nacks.back().request.parts_max &&
                         nacks.back().request.messages < kMaxWholeMessages &&
                         nacks.back().number + nacks.back().request.messages == number;
      if (joins) {
        ++nacks.back().request.messages;
      } else {
        nacks.push_back({number, stamp_nanos, {msg_type, parts_max, 1, 0, parts}, copies});
      }
      entry.due_nanos = now_nanos + round_trip_.wait_nanos(entry.tries++);
      entry.requested_nanos = now_nanos;
    }
    return nacks;
  }

  /// Whether a number is no jump ahead (PROTOCOL.md, section 7), or the second one in a row.
  ///
  /// `apart` is how far the second one may be ahead of the first: 1, or more for Offers.
  bool is_plausible(std::uint32_t number, std::uint32_t apart) {
    if (!has_newest_ || static_cast<std::int32_t>(number - newest_) < kMaxAhead) return true;
    const std::uint32_t behind_jump = number - jump_ - 1;
    jump_ = number;
    if (behind_jump >= apart) return false;
    reset();
    return true;
  }

  /// How far two believed Offers may be apart.
  static constexpr std::uint32_t kOffersApart = 3000;

 private:
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
  static constexpr std::size_t kMaxEntries = 64;
  static constexpr std::size_t kFinished = 256;
  static constexpr int kMaxTries = 16;
  static constexpr int kMaxCopies = 3;
  static constexpr std::int32_t kMaxAhead = 3000;

  /// An incomplete message.
  struct Entry {
    explicit Entry(std::int64_t now_nanos) : since_nanos(now_nanos) {}

    std::int64_t since_nanos;  // when its first part, or the gap, was noticed
    std::int64_t due_nanos = kNever, requested_nanos = 0;
    std::int64_t stamp_nanos = 0;
    std::uint8_t parts_max = 0;  // 0 while no part has arrived
    int sent_to = 0;             // parts before this one were sent
    int tries = 0;
    Parts received;
  };

  static Parts missing(const Entry& entry) {
    Parts parts;
    const auto sent_to = static_cast<std::size_t>(entry.sent_to);
    for (std::size_t part = 0; part < sent_to; ++part) {
      if (!entry.received.test(part)) parts.set(part);
    }
    return parts;
  }

  /// Whether a message that is neither tracked nor finished shows a restarted sender.
  bool is_restart(const udp_bridge::Header& header) const {
    if (!has_newest_ || static_cast<std::int32_t>(header.seq_number - newest_) > 0) return false;
    return header.stamp_nanos() > newest_stamp_nanos_ && !entries_.count(header.seq_number) &&
           !is_finished(header);
  }

  void reset() {
    entries_.clear();
    finished_.clear();
    has_newest_ = false;
    was_reset_ = true;
  }

  /// Track the gap before a number that is ahead; return whether it is.
  bool advance(const udp_bridge::Header& header, std::int64_t now_nanos) {
    const std::uint32_t number = header.seq_number;
    const bool is_first = !has_newest_;
    if (is_first) {
      // Of a sender that was restarted just now, the first messages are missing, too.
      has_newest_ = true;
      newest_ = was_reset_ && number < kMaxEntries ? ~std::uint32_t{0} : number - 1;
    }
    const auto ahead = static_cast<std::int32_t>(number - newest_);
    if (ahead <= 0) return is_first;
    const std::int64_t due_nanos = now_nanos + round_trip_.debounce_nanos();
    const auto last = entries_.find(newest_);
    if (last != entries_.end() && last->second.parts_max) {
      last->second.sent_to = last->second.parts_max;
      last->second.due_nanos = std::min(last->second.due_nanos, due_nanos);
    }
    const auto gap = static_cast<std::uint32_t>(std::min<std::int64_t>(ahead - 1, kMaxEntries));
    for (std::uint32_t back = gap; back > 0; --back) {
      entries_.try_emplace(number - back, now_nanos).first->second.due_nanos = due_nanos;
    }
    while (entries_.size() > kMaxEntries) {
      entries_.erase(std::min_element(entries_.begin(), entries_.end(),
                                      [](const auto& a, const auto& b) {
                                        return a.second.since_nanos < b.second.since_nanos;
                                      }));
    }
    newest_ = number;
    newest_stamp_nanos_ = header.stamp_nanos();
    return true;
  }

  bool is_finished(const udp_bridge::Header& header) const {
    return std::find(finished_.begin(), finished_.end(),
                     std::pair(header.seq_number, header.stamp_nanos())) != finished_.end();
  }

  void finish(const udp_bridge::Header& header) {
    finished_.emplace_back(header.seq_number, header.stamp_nanos());
    if (finished_.size() > kFinished) finished_.pop_front();
  }

  std::int64_t limit_nanos_ = 0;
  bool has_newest_ = false, was_reset_ = false;
  std::uint32_t newest_ = 0, jump_ = 0;
  std::int64_t newest_stamp_nanos_ = 0;
  std::map<std::uint32_t, Entry> entries_;
  std::deque<std::pair<std::uint32_t, std::int64_t>> finished_;
  RoundTrip round_trip_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_RECEIVER_NACK_TRACKER_HPP
