// SPDX-License-Identifier: Apache-2.0
//
// The ledger of responses by its terminal: each line of stdin is a call, and what it answers is a
// line of stdout. `expect TOPIC OF EVERY` lines come first.

#include <iostream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "udp_bridge_cpp/node/response_ledger.hpp"

using udp_bridge_cpp::ExpectedResponse;
using udp_bridge_cpp::ResponseLedger;

int main() {
  std::vector<ExpectedResponse> expected;
  ResponseLedger ledger;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words(line);
    std::string verb, topic, second;
    words >> verb >> topic >> second;
    ResponseLedger::Stamp stamp_nanos;
    if (verb != "expect" && !second.empty()) stamp_nanos = std::stoll(second);
    if (verb == "expect") {
      int every = 0;
      words >> every;
      expected.push_back({0, static_cast<std::uint8_t>(every), topic, second});
      ledger = ResponseLedger(expected);
    } else if (verb == "published") {
      if (ledger.published(topic, stamp_nanos)) std::cout << "worked_on ";
    } else if (verb == "received") {
      ledger.received(topic, stamp_nanos);
    } else if (verb == "forgive") {
      ledger.forgive(topic);
    } else if (verb == "settle") {
      for (const auto& [name, count] : ledger.settle()) std::cout << name << '=' << count << ' ';
    } else if (verb == "caused") {
      for (const std::string& name : ledger.caused({topic})) std::cout << name << ' ';
    }
    std::cout << ledger.owing() << '\n';
  }
}
