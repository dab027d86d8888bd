// SPDX-License-Identifier: Apache-2.0
// Property: whatever arrives, the receiver keeps within its memory and every message that it hands
// over has a legal header. fuzz DATAGRAMS SEED FILE...: datagrams of the files, mutated, mixed and
// repeated; built with AddressSanitizer and UBSan by the test.

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>

#include "udp_bridge.hpp"

using Datagram = std::vector<std::uint8_t>;

namespace {

std::vector<Datagram> read(const char* name) {
  std::ifstream file(name, std::ios::binary);
  const std::vector<char> text((std::istreambuf_iterator<char>(file)), {});
  const auto* data = reinterpret_cast<const std::uint8_t*>(text.data());
  std::vector<Datagram> found;
  for (std::size_t at = 0; at + 4 <= text.size();) {
    const std::size_t size = udp_bridge::detail::read_u32(data + at);
    found.emplace_back(data + at + 4, data + at + 4 + size);
    at += 4 + size;
  }
  return found;
}

void mutate(Datagram& datagram, std::mt19937_64& random) {
  const auto below = [&](std::size_t n) { return static_cast<std::size_t>(random() % n); };
  for (std::size_t i = below(4); i; --i) {
    if (datagram.empty()) return;
    // Headers are where decisions are made.
    const std::size_t at = below(std::min<std::size_t>(datagram.size(), below(2) ? 24 : 2000));
    switch (below(5)) {
      case 0: datagram[at] = static_cast<std::uint8_t>(random()); break;
      case 1: datagram[at] ^= static_cast<std::uint8_t>(1u << below(8)); break;
      case 2: datagram.resize(below(datagram.size() + 1)); break;
      case 3: datagram.insert(datagram.begin() + static_cast<std::ptrdiff_t>(at), below(40),
                              static_cast<std::uint8_t>(random())); break;
      case 4:  // another place among few messages, of which some are finished and some are open
        if (datagram.size() < 16) break;
        udp_bridge::detail::write_u32(datagram.data() + 2, static_cast<std::uint32_t>(below(6)));
        udp_bridge::detail::write_u32(datagram.data() + 8, static_cast<std::uint32_t>(below(3)));
        datagram[6] = static_cast<std::uint8_t>(below(4));
        datagram[7] = static_cast<std::uint8_t>(1 + below(below(2) ? 4 : 255));
        break;
    }
  }
}

}  // namespace

int main(int count, char** argv) {
  std::mt19937_64 random(std::strtoull(argv[2], nullptr, 10));
  std::vector<Datagram> seeds;
  for (int i = 3; i < count; ++i) {
    for (Datagram& datagram : read(argv[i])) seeds.push_back(std::move(datagram));
  }
  udp_bridge::Limits limits;
  limits.memory_bytes = 1 << 20;
  limits.senders = 3;
  limits.topics = 20;
  udp_bridge::Receiver receiver(limits);
  std::uint64_t taken = 0, handed = 0, credits = 0;
  std::int64_t now = 0;
  for (const std::uint64_t wanted = std::strtoull(argv[1], nullptr, 10); taken < wanted; ++taken) {
    // Half of all is of one topic and sender, so that much meets much.
    const bool is_common = random() % 2;
    Datagram datagram = seeds[is_common ? 0 : random() % seeds.size()];
    mutate(datagram, random);
    datagram.shrink_to_fit();  // one byte read past its end is an error
    now += static_cast<std::int64_t>(random() % 20000000);
    if (random() % 50 == 0) now += 1100000000;  // a topic was silent
    receiver.take(
        datagram.data(), datagram.size(), is_common ? 0 : random() % 5, now,
        [&](udp_bridge::Message&& m) {
          ++handed;
          if (!m.header.is_legal()) std::abort();
        },
        [&](const std::uint8_t*, std::size_t size) {
          ++credits;
          if (size > 256 + 12) std::abort();
        });
    if (taken % 100 == 0) {
      receiver.report(now, now, [](std::uint64_t, const std::uint8_t* told, std::size_t size) {
        udp_bridge::TopicReport report;
        const std::size_t head = told[1];
        if (udp_bridge::TopicReport::parse(told + head, size - head, report) !=
            udp_bridge::Refusal::none) {
          std::abort();
        }
      });
    }
    if (receiver.memory_bytes() > limits.memory_bytes) std::abort();
  }
  receiver.give_up_all();
  if (receiver.memory_bytes()) std::abort();
  std::printf("%llu %llu %llu\n", static_cast<unsigned long long>(taken),
              static_cast<unsigned long long>(handed), static_cast<unsigned long long>(credits));
}
