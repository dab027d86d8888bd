// SPDX-License-Identifier: Apache-2.0
// What a Receiver reports and answers, a line in hex for each datagram: report DATAGRAMS WALL BUFFER.
// The file has rows of NOW_NANOS as an int64, SENDER as a byte and SIZE as a uint32 before each
// datagram; with sender 255 it is a time to report. WALL is what the wall clock is ahead of the other.
// Messages with the link "refused" are those that the user can't take. Sender 1's challenges are
// answered. Sender 0 begins a new receiver, which a line with `end` says.

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <optional>

#include "udp_bridge.hpp"

namespace {

void print(const char* word, std::uint64_t sender, const std::uint8_t* data, std::size_t size) {
  std::printf("%s %llu ", word, static_cast<unsigned long long>(sender));
  for (std::size_t i = 0; i < size; ++i) std::printf("%02x", data[i]);
  std::printf("\n");
}

}  // namespace

int main(int, char** argv) {
  std::ifstream file(argv[1], std::ios::binary);
  const std::vector<char> text((std::istreambuf_iterator<char>(file)), {});
  const auto* data = reinterpret_cast<const std::uint8_t*>(text.data());
  const std::int64_t wall = std::atoll(argv[2]);
  udp_bridge::Limits limits;
  limits.receive_buffer = static_cast<std::uint32_t>(std::atoll(argv[3]));
  std::optional<udp_bridge::Receiver> made;
  const auto begin = [&] { made.emplace(limits).answer_challenges_of(1); };
  begin();
  for (std::size_t at = 0; at < text.size();) {
    const auto now = static_cast<std::int64_t>(udp_bridge::detail::read_u64(data + at));
    const std::uint8_t sender = data[at + 8];
    const std::size_t size = udp_bridge::detail::read_u32(data + at + 9);
    at += 13;
    udp_bridge::Receiver& receiver = *made;
    if (sender == 0) {
      std::printf("end\n");
      begin();
      continue;
    }
    if (sender == 255) {
      receiver.report(now, now + wall, [](std::uint64_t to, const std::uint8_t* told,
                                          std::size_t bytes) { print("report", to, told, bytes); });
      continue;
    }
    const auto before = receiver.counters.refused;
    receiver.take(
        data + at, size, sender, now,
        [](udp_bridge::Message&& message) {
          udp_bridge::Subscribe told;
          if (message.header.msg_type == udp_bridge::kSubscribe &&
              udp_bridge::Subscribe::parse(message.body.data(), message.body.size(), told) ==
                  udp_bridge::Refusal::none) {
            std::printf("subscribe %d %d %d %a\n", told.wanted_type, told.wanted, told.lease_s,
                        static_cast<double>(told.max_rate_hz));
          }
          return message.header.link != "refused";
        },
        [&](const std::uint8_t* answer, std::size_t bytes) {
          print("answer", sender, answer, bytes);
        });
    for (std::size_t i = 0; i < before.size(); ++i) {
      if (receiver.counters.refused[i] > before[i]) {
        std::printf("refused %s\n", udp_bridge::name_of(static_cast<udp_bridge::Refusal>(i)));
      }
    }
    at += size;
  }
}
