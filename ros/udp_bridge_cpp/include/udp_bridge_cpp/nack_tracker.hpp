// SPDX-License-Identifier: Apache-2.0
//
// The receiver's side of Resend for one topic: which lost parts and messages to request, and when
// (PROTOCOL.md, 9.2).
//
// It has no timer: datagrams of the topic, Offers included, are the occasions to request what is due.

#ifndef UDP_BRIDGE_CPP_NACK_TRACKER_HPP
#define UDP_BRIDGE_CPP_NACK_TRACKER_HPP

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "resend_bodies.hpp"
#include "udp_bridge.hpp"

namespace udp_bridge_cpp {

/// A Request, with the fields of its header and how often to send it.
struct Nack {
  std::uint32_t number = 0;
  std::int64_t stamp_nanos = 0;
  Request request;
  int copies = 1;
};

/// Time from a request to the requested part (RFC 6298).
class RoundTrip {
 public:
  void add(std::int64_t nanos) {
    const auto measured = static_cast<double>(nanos);
    if (nanos_ == 0) {
      nanos_ = measured;
      deviation_ = measured / 2;
      return;
    }
    deviation_ += (std::abs(measured - nanos_) - deviation_) / 4;
    nanos_ += (measured - nanos_) / 8;
  }

  /// Delay from the detection of a gap to its request.
  std::int64_t debounce_nanos() const {
    return nanos_ == 0 ? kMillisecond : std::min(kMillisecond, static_cast<std::int64_t>(nanos_ / 4));
  }

  /// Time until a request is repeated that was preceded by `tries` others.
  std::int64_t wait_nanos(int tries) const {
    const double wait = nanos_ == 0 ? 50e6 : nanos_ + std::max(1e6, 4 * deviation_);
    return static_cast<std::int64_t>(std::min(wait * std::min(std::pow(1.5, tries), 3.0), 5e8));
  }

 private:
  static constexpr std::int64_t kMillisecond = 1000000;
  double nanos_ = 0, deviation_ = 0;
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
    const Arrival arrival{restarts(header), false};
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
    Arrival arrival{restarts(header), false};
    if (arrival.is_restart) reset();
    advance(header, now_nanos);
    if (is_finished(header)) return arrival;
    const auto found = entries_.try_emplace(header.seq_number, now_nanos).first;
    Entry& entry = found->second;
    if (entry.tries == 1 && (!entry.parts_max || header.part_number < entry.sent_to)) {
      round_trip_.add(now_nanos - entry.requested_nanos);
    }
    if (entry.stamp_nanos != header.stamp_nanos() || entry.parts_max != header.parts_max) {
      entry.came.reset();
      entry.stamp_nanos = header.stamp_nanos();
      entry.parts_max = header.parts_max;
    }
    entry.came.set(header.part_number);
    if (entry.came.count() == header.parts_max) {
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
      if (now_nanos - entry.since_nanos > limit_nanos_ || entry.tries >= kMostTries) {
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
      const int copies = std::min(1 + (entry.tries + 1) / 2, kMostCopies);
      const std::uint8_t parts_max = parts.any() ? entry.parts_max : std::uint8_t{0};
      const std::int64_t stamp_nanos = parts_max ? entry.stamp_nanos : 0;
      const bool joins = !parts_max && !nacks.empty() && !nacks.back().request.parts_max &&
                         nacks.back().request.messages < kMostWholeMessages &&
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
  bool believes(std::uint32_t number, std::uint32_t apart) {
    if (!has_newest_ || static_cast<std::int32_t>(number - newest_) < kMostAhead) return true;
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
  static constexpr std::size_t kMostEntries = 64;
  static constexpr std::size_t kFinished = 256;
  static constexpr int kMostTries = 16;
  static constexpr int kMostCopies = 3;
  static constexpr std::int32_t kMostAhead = 3000;

  /// An incomplete message.
  struct Entry {
    explicit Entry(std::int64_t now_nanos) : since_nanos(now_nanos) {}

    std::int64_t since_nanos;  // when its first part, or the gap, was noticed
    std::int64_t due_nanos = kNever, requested_nanos = 0;
    std::int64_t stamp_nanos = 0;
    std::uint8_t parts_max = 0;  // 0 while no part has arrived
    int sent_to = 0;             // parts before this one were sent
    int tries = 0;
    Parts came;
  };

  static Parts missing(const Entry& entry) {
    Parts parts;
    for (int part = 0; part < entry.sent_to; ++part) {
      if (!entry.came.test(static_cast<std::size_t>(part))) parts.set(static_cast<std::size_t>(part));
    }
    return parts;
  }

  /// Whether a message that is neither tracked nor finished shows a restarted sender.
  bool restarts(const udp_bridge::Header& header) const {
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
      newest_ = was_reset_ && number < kMostEntries ? ~std::uint32_t{0} : number - 1;
    }
    const auto ahead = static_cast<std::int32_t>(number - newest_);
    if (ahead <= 0) return is_first;
    const std::int64_t due_nanos = now_nanos + round_trip_.debounce_nanos();
    if (const auto last = entries_.find(newest_); last != entries_.end() && last->second.parts_max) {
      last->second.sent_to = last->second.parts_max;
      last->second.due_nanos = std::min(last->second.due_nanos, due_nanos);
    }
    const auto gap = static_cast<std::uint32_t>(std::min<std::int64_t>(ahead - 1, kMostEntries));
    for (std::uint32_t back = gap; back > 0; --back) {
      entries_.try_emplace(number - back, now_nanos).first->second.due_nanos = due_nanos;
    }
    while (entries_.size() > kMostEntries) {
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

#endif  // UDP_BRIDGE_CPP_NACK_TRACKER_HPP
