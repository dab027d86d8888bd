// SPDX-License-Identifier: Apache-2.0
//
// Conversion between CDR and ROS 1's serialization, by a plan made once for each type.
//
// Both are little-endian. CDR aligns each number to its size, counted from the end of the
// encapsulation; ROS 1 packs. A string of CDR ends with a NUL, which is part of its length. A
// Header of ROS 1 begins with `seq`, which CDR lacks. Fields that ROS 2 added at the end are
// dropped.

#ifndef UDP_BRIDGE_ROSCPP_CONVERSION_PLAN_HPP
#define UDP_BRIDGE_ROSCPP_CONVERSION_PLAN_HPP

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "definition.hpp"
#include "udp_bridge_cpp/wire/message.hpp"

namespace udp_bridge_roscpp {

using udp_bridge_cpp::Bytes;

/// Bytes are no message of their type.
struct MalformedMessage : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Converts the messages of one type.
class ConversionPlan {
 public:
  /// Throws TypeNotInstalled where the definition of a part is missing.
  ConversionPlan(Definitions& definitions, const std::string& type_name) {
    const std::vector<Field> fields = definitions.fields(type_name);
    is_stamped_ = !fields.empty() && fields[0].type_name == Definitions::kHeader &&
                  !fields[0].length;
    add(definitions, fields, type_name == Definitions::kHeader, steps_);
  }

  /// Whether messages begin with a Header; those of ROS 1 then begin with its seq.
  bool is_stamped() const { return is_stamped_; }

  /// Return a message of ROS 1, whose seqs are 0; throw MalformedMessage.
  Bytes to_ros1(const std::uint8_t* cdr, std::size_t size) const {
    if (size < kEncapsulation || cdr[0] != 0 || cdr[1] != 1) {
      throw MalformedMessage("this is no little-endian CDR");
    }
    Bytes message;
    message.reserve(size + 64);
    Conversion conversion{cdr + kEncapsulation, size - kEncapsulation, message, 0, true};
    conversion.run(steps_);
    return message;
  }

  /// Return a message as CDR with its encapsulation; throw MalformedMessage.
  Bytes to_cdr(const std::uint8_t* ros1, std::size_t size) const {
    Bytes message = {0, 1, 0, 0};
    message.reserve(2 * size + 64);
    Conversion conversion{ros1, size, message, kEncapsulation, false};
    conversion.run(steps_);
    if (conversion.at != size) throw MalformedMessage("there are bytes behind the message");
    return message;
  }

 private:
  static constexpr std::size_t kEncapsulation = 4;

  /// A field of a message, or several fields that are copied as one.
  struct Step {
    enum Kind { numbers, seq, text, array_of_numbers, array } kind = numbers;
    std::size_t alignment = 1, size = 1;  // of numbers: all of a fixed array
    std::vector<Step> each;               // of the elements of an array
  };

  /// A conversion in progress.
  struct Conversion {
    const std::uint8_t* data;
    std::size_t size;
    Bytes& out;
    std::size_t out_begin;  // where alignment is counted from
    bool is_to_ros1;
    std::size_t at = 0;

    void run(const std::vector<Step>& steps) {
      for (const Step& step : steps) {
        switch (step.kind) {
          case Step::numbers: copy(step.alignment, step.size); break;
          case Step::seq: skip_seq(); break;
          case Step::text: copy_text(); break;
          case Step::array_of_numbers: {
            const std::size_t count = length();
            if (count) copy(step.alignment, count * step.size);
            break;
          }
          case Step::array: {
            const std::size_t count = length();
            for (std::size_t i = 0; i < count && !step.each.empty(); ++i) run(step.each);
            break;
          }
        }
      }
    }

    /// Copy so many bytes, aligned on the side of CDR.
    void copy(std::size_t alignment, std::size_t count) {
      align(alignment);
      const std::uint8_t* from = take(count);
      out.insert(out.end(), from, from + count);
    }

    void align(std::size_t alignment) {
      if (is_to_ros1) {
        take((alignment - at % alignment) % alignment);
      } else {
        while ((out.size() - out_begin) % alignment) out.push_back(0);
      }
    }

    /// Read a length, and write it with `difference` added: strings of CDR count their NUL.
    std::size_t length(std::int64_t difference = 0) {
      align(4);
      const std::uint32_t count = udp_bridge::detail::read_u32(take(4));
      const std::int64_t written = std::max<std::int64_t>(0, count + difference);
      out.resize(out.size() + 4);
      udp_bridge::detail::write_u32(out.data() + out.size() - 4,
                                    static_cast<std::uint32_t>(written));
      return count;
    }

    void copy_text() {
      const std::size_t count = length(is_to_ros1 ? -1 : 1);
      const std::uint8_t* from = take(count);
      const bool has_nul = is_to_ros1 && count;  // some writers omit that of an empty string
      if (has_nul && from[count - 1]) throw MalformedMessage("a string does not end with NUL");
      out.insert(out.end(), from, from + count - has_nul);
      if (!is_to_ros1) out.push_back(0);
    }

    void skip_seq() {
      if (is_to_ros1) {
        out.insert(out.end(), 4, 0);
      } else {
        take(4);
      }
    }

    const std::uint8_t* take(std::size_t count) {
      if (size - at < count) throw MalformedMessage("it ends within a field");
      at += count;
      return data + at - count;
    }
  };

  static void add(Definitions& definitions, const std::vector<Field>& fields, bool is_header,
                  std::vector<Step>& to) {
    bool is_seq = is_header;  // the first field of a Header
    for (const Field& field : fields) {
      if (is_seq) {
        to.push_back({Step::seq, 4, 4, {}});
        is_seq = false;
        continue;
      }
      const auto number = Primitive::of(field.type_name);
      if (number) {
        const bool is_array = field.length == -1;
        const auto count = static_cast<std::size_t>(is_array ? 1 : field.length.value_or(1));
        to.push_back({is_array ? Step::array_of_numbers : Step::numbers, number->alignment,
                      number->size * count, {}});
        continue;
      }
      std::vector<Step> one;
      if (field.type_name == "string") {
        one.push_back({Step::text, 4, 4, {}});
      } else {
        add(definitions, definitions.fields(field.type_name),
            field.type_name == Definitions::kHeader, one);
      }
      if (field.length == -1) {
        to.push_back({Step::array, 4, 4, std::move(one)});
      } else {
        for (int i = 0; i < field.length.value_or(1); ++i) {
          to.insert(to.end(), one.begin(), one.end());
        }
      }
    }
  }

  bool is_stamped_ = false;
  std::vector<Step> steps_;
};

}  // namespace udp_bridge_roscpp

#endif  // UDP_BRIDGE_ROSCPP_CONVERSION_PLAN_HPP
