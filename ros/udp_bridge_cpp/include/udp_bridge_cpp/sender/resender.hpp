// SPDX-License-Identifier: Apache-2.0
//
// The sender's side of Resend towards one peer: history, budget and offers (PROTOCOL.md, 9.2).

#ifndef UDP_BRIDGE_CPP_SENDER_RESENDER_HPP
#define UDP_BRIDGE_CPP_SENDER_RESENDER_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <iterator>
#include <list>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "udp_bridge.hpp"
#include "udp_bridge_cpp/sender/resend_budget.hpp"
#include "udp_bridge_cpp/wire/message.hpp"
#include "udp_bridge_cpp/wire/resend_bodies.hpp"

namespace udp_bridge_cpp {

/// Messages that were sent and may be requested.
class Resender {
 public:
  using Emit = std::function<void(Bytes&&)>;

  /// Keep the datagrams of a message that is being sent, and offer it from now on.
  void add(std::uint8_t msg_type, const std::string& topic, std::uint32_t number,
           std::int64_t stamp_nanos, std::vector<Bytes>&& datagrams, std::int64_t limit_nanos,
           std::int64_t now_nanos) {
    Entry& entry = entries_.emplace_back();
    entry.header.msg_type = msg_type;
    entry.header.topic = topic;
    entry.header.seq_number = number;
    entry.header.set_stamp(stamp_nanos);
    for (const Bytes& datagram : datagrams) entry.bytes += datagram.size();
    entry.datagrams = std::move(datagrams);
    entry.since_nanos = now_nanos;
    entry.limit_nanos = limit_nanos;
    bytes_ += entry.bytes;
    budget_.sent(entry.bytes, now_nanos);
    by_key_[{msg_type, topic, number}] = std::prev(entries_.end());
    offer(entry, now_nanos);
    clean(now_nanos);
  }

  /// Send the requested datagrams that are kept and within the budget.
  void requested(const udp_bridge::Header& header, const Request& request, std::int64_t now_nanos,
                 const Emit& emit) {
    clean(now_nanos);
    budget_.goodput_reported(request.goodput, now_nanos);
    for (std::uint32_t i = 0; i < request.messages; ++i) {
      const auto found =
          by_key_.find({request.msg_type, header.topic, header.seq_number + i});
      if (found == by_key_.end()) continue;
      Entry& entry = *found->second;
      if (request.parts.any() && (request.parts_max != entry.datagrams.size() ||
                                  header.stamp_nanos() != entry.header.stamp_nanos())) {
        continue;
      }
      if (entry.requested == request.parts && now_nanos - entry.requested_nanos < kCopyNanos) {
        continue;  // a copy of the request
      }
      entry.requested = request.parts;
      entry.requested_nanos = now_nanos;
      resend(entry, request.parts, now_nanos, emit);
    }
  }

  /// Send the Offers that are due; return when the next one is, or a time far away.
  std::int64_t turn(std::int64_t now_nanos, const Emit& emit) {
    std::int64_t next = now_nanos + udp_bridge::kNanos;
    for (auto at = offers_.begin(); at != offers_.end();) {
      TopicOffer& offer = at->second;
      if (now_nanos > offer.since_nanos + offer.limit_nanos) {
        at = offers_.erase(at);
        continue;
      }
      if (offer.due_nanos <= now_nanos) {
        emit(offer.datagram());
        offer.sent_nanos = now_nanos;
        offer.due_nanos = now_nanos + offer.step_nanos;
        offer.step_nanos = std::min(2 * offer.step_nanos, kLongestStepNanos);
      }
      next = std::min(next, offer.due_nanos);
      ++at;
    }
    return next;
  }

  /// Datagrams that were not resent because the budget was exhausted.
  std::uint64_t over_budget() const { return over_budget_; }

 private:
  static constexpr std::size_t kMaxBytes = 64u << 20;
  static constexpr std::size_t kMaxMessages = 4096;
  static constexpr std::int64_t kCopyNanos = 1500000;
  static constexpr std::int64_t kFirstStepNanos = 1000000;  // between Offers of several parts
  static constexpr std::int64_t kSmallStepNanos = 5000000;  // between those of single parts
  static constexpr std::int64_t kLongestStepNanos = 20000000;

  struct Entry {
    udp_bridge::Header header;  // without its link
    std::vector<Bytes> datagrams;
    std::size_t bytes = 0;
    std::int64_t since_nanos = 0, limit_nanos = 0, requested_nanos = 0;
    Parts requested;
  };
  using Key = std::tuple<std::uint8_t, std::string, std::uint32_t>;

  struct TopicOffer {
    udp_bridge::Header header;
    Offer body;
    std::int64_t since_nanos = 0, limit_nanos = 0, due_nanos = 0, sent_nanos = 0, step_nanos = 0;

    Bytes datagram() const {
      Bytes bytes(header.size());
      header.pack(bytes.data());
      const Bytes packed = body.pack();
      bytes.insert(bytes.end(), packed.begin(), packed.end());
      return bytes;
    }
  };

  void offer(const Entry& entry, std::int64_t now_nanos) {
    const bool is_small = entry.datagrams.size() == 1;
    TopicOffer& offer = offers_[{entry.header.msg_type, entry.header.topic}];
    const std::int64_t pause_end = offer.sent_nanos + kSmallStepNanos;
    offer.due_nanos = is_small && offer.sent_nanos ? std::max(now_nanos, pause_end) : now_nanos;
    offer.header = entry.header;
    offer.header.msg_type = kResend;
    offer.body = {entry.header.msg_type, static_cast<std::uint8_t>(entry.datagrams.size()),
                  static_cast<std::uint32_t>((entry.limit_nanos + 999999) / 1000000)};
    offer.since_nanos = entry.since_nanos;
    offer.limit_nanos = entry.limit_nanos;
    offer.step_nanos = is_small ? kSmallStepNanos : kFirstStepNanos;
  }

  void resend(Entry& entry, const Parts& parts, std::int64_t now_nanos, const Emit& emit) {
    for (std::size_t part = 0; part < entry.datagrams.size(); ++part) {
      if (parts.any() && !parts.test(part)) continue;
      if (budget_.spend(entry.datagrams[part].size(), now_nanos)) {
        emit(Bytes(entry.datagrams[part]));
      } else {
        ++over_budget_;
      }
    }
    const auto found = offers_.find({entry.header.msg_type, entry.header.topic});
    if (found == offers_.end() || entry.datagrams.size() == 1) return;
    TopicOffer& offer = found->second;
    if (offer.header.seq_number != entry.header.seq_number) return;
    // Behind a single resent part an immediate Offer could overtake it unnoticed.
    offer.due_nanos = now_nanos + (parts.count() == 1 ? kFirstStepNanos : 0);
    offer.step_nanos = kFirstStepNanos;
  }

  void clean(std::int64_t now_nanos) {
    while (!entries_.empty()) {
      const Entry& oldest = entries_.front();
      const bool is_stale = now_nanos - oldest.since_nanos > oldest.limit_nanos;
      if (!is_stale && bytes_ <= kMaxBytes && entries_.size() <= kMaxMessages) return;
      const udp_bridge::Header& header = oldest.header;
      const auto found = by_key_.find({header.msg_type, header.topic, header.seq_number});
      if (found != by_key_.end() && found->second == entries_.begin()) by_key_.erase(found);
      bytes_ -= oldest.bytes;
      entries_.pop_front();
    }
  }

  std::list<Entry> entries_;  // oldest first
  std::map<Key, std::list<Entry>::iterator> by_key_;
  std::map<TopicKey, TopicOffer> offers_;
  std::size_t bytes_ = 0;
  std::uint64_t over_budget_ = 0;
  ResendBudget budget_;
};

}  // namespace udp_bridge_cpp

#endif  // UDP_BRIDGE_CPP_SENDER_RESENDER_HPP
