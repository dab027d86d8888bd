// SPDX-License-Identifier: Apache-2.0
//
// Definitions of ROS 1 messages: fields, checksum and full text, by the name of a type.

#ifndef UDP_BRIDGE_ROSCPP_DEFINITION_HPP
#define UDP_BRIDGE_ROSCPP_DEFINITION_HPP

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "md5.hpp"
#include "udp_bridge_cpp/node/ros.hpp"

namespace udp_bridge_roscpp {

/// A field of a message.
struct Field {
  std::string type_name;  ///< a primitive, or the full name of a type
  std::string written;    ///< the type as the definition has it, with its brackets
  std::string name;
  std::optional<int> length;  ///< of a fixed array; -1 for one of any length; none for no array
};

/// The primitives of ROS 1: alignment and size in CDR, where they are numbers.
struct Primitive {
  std::size_t alignment = 1, size = 1;

  static std::optional<Primitive> of(const std::string& type_name) {
    static const std::map<std::string, Primitive> numbers = {
        {"bool", {1, 1}},   {"byte", {1, 1}},   {"char", {1, 1}},    {"int8", {1, 1}},
        {"uint8", {1, 1}},  {"int16", {2, 2}},  {"uint16", {2, 2}},  {"int32", {4, 4}},
        {"uint32", {4, 4}}, {"int64", {8, 8}},  {"uint64", {8, 8}},  {"float32", {4, 4}},
        {"float64", {8, 8}}, {"time", {4, 8}},  {"duration", {4, 8}}};
    const auto found = numbers.find(type_name);
    if (found == numbers.end()) return std::nullopt;
    return found->second;
  }
};

/// All definitions that this host has: those that were added, and .msg files.
class Definitions {
 public:
  static constexpr const char* kHeader = "std_msgs/Header";

  /// Add a full definition: the text of a type, and those of all types that it contains, each
  /// after a line of `=` and a line `MSG: package/Name`.
  void add(const std::string& type_name, const std::string& full_text) {
    static const std::string mark = "\nMSG: ";
    std::string name = type_name;
    std::size_t begin = 0;
    for (std::size_t at; (at = full_text.find(mark, begin)) != std::string::npos;) {
      const std::size_t end = full_text.find('\n', at + mark.size());
      texts_.emplace(name, full_text.substr(begin, full_text.rfind('\n', at - 1) - begin));
      name = trimmed(full_text.substr(at + mark.size(), end - at - mark.size()));
      begin = end + 1;
    }
    texts_.emplace(name, full_text.substr(begin));
  }

  /// Return the fields of a type such as sensor_msgs/Imu; throw TypeNotInstalled.
  std::vector<Field> fields(const std::string& type_name) {
    std::vector<Field> found;
    std::istringstream lines(text(type_name));
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line.substr(0, line.find('#')));
      Field field;
      if (line.find('=') < line.find('#') || !(words >> field.written >> field.name)) continue;
      const std::size_t bracket = field.written.find('[');
      field.type_name = full_name(field.written.substr(0, bracket), type_name);
      if (bracket != std::string::npos) {
        const std::string length = field.written.substr(bracket + 1);
        field.length = length == "]" ? -1 : std::stoi(length);
      }
      found.push_back(std::move(field));
    }
    return found;
  }

  /// Return the checksum by which ROS 1 compares types.
  std::string checksum(const std::string& type_name) {
    std::string lines;
    std::istringstream whole(text(type_name));
    for (std::string line; std::getline(whole, line);) {
      std::istringstream words(line);
      std::string type;
      words >> type;
      // The value of a string constant takes the rest of its line.
      const std::string code = type == "string" ? line : line.substr(0, line.find('#'));
      const std::size_t equals = code.find('=');
      if (equals == std::string::npos || line.find('#') < equals) continue;
      const std::size_t name = code.find(type) + type.size();
      lines += type + ' ' + trimmed(code.substr(name, equals - name)) + '=' +
               trimmed(code.substr(equals + 1)) + '\n';
    }
    for (const Field& field : fields(type_name)) {
      lines += (is_primitive(field.type_name) ? field.written : checksum(field.type_name)) + ' ' +
               field.name + '\n';
    }
    if (!lines.empty()) lines.pop_back();
    return md5(lines);
  }

  /// Return the text of a type, and those of all types that it contains.
  std::string full_text(const std::string& type_name) {
    std::string full = text(type_name);
    std::set<std::string> named = {type_name};
    append_parts(type_name, named, full);
    return full;
  }

  static bool is_primitive(const std::string& type_name) {
    return type_name == "string" || Primitive::of(type_name);
  }

 private:
  static std::string trimmed(const std::string& text) {
    const std::size_t begin = text.find_first_not_of(" \t\r");
    if (begin == std::string::npos) return {};
    return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
  }

  static std::string full_name(const std::string& name, const std::string& within) {
    if (is_primitive(name) || name.find('/') != std::string::npos) return name;
    if (name == "Header") return kHeader;
    return within.substr(0, within.find('/') + 1) + name;
  }

  void append_parts(const std::string& type_name, std::set<std::string>& named, std::string& full) {
    for (const Field& field : fields(type_name)) {
      if (is_primitive(field.type_name) || !named.insert(field.type_name).second) continue;
      full += '\n' + std::string(80, '=') + "\nMSG: " + field.type_name + '\n';
      full += text(field.type_name);
      append_parts(field.type_name, named, full);
    }
  }

  const std::string& text(const std::string& type_name) {
    const auto known = texts_.find(type_name);
    if (known != texts_.end()) return known->second;
    const std::size_t slash = type_name.find('/');
    const std::string package = type_name.substr(0, slash);
    const std::filesystem::path file =
        std::filesystem::path(package) / "msg" / (type_name.substr(slash + 1) + ".msg");
    for (const std::filesystem::path& root : roots()) {
      std::ifstream found(root / file);
      if (!found) continue;
      return texts_.emplace(type_name, std::string(std::istreambuf_iterator<char>(found), {}))
          .first->second;
    }
    throw udp_bridge_cpp::TypeNotInstalled("ROS package " + package + " has no " + file.string() +
                                           " on ROS_PACKAGE_PATH. Fix: install it");
  }

  /// Folders that hold packages.
  static std::vector<std::filesystem::path> roots() {
    std::vector<std::filesystem::path> found;
    for (const auto& [variable, below] :
         {std::pair("ROS_PACKAGE_PATH", ""), {"CMAKE_PREFIX_PATH", "share"}}) {
      const char* value = std::getenv(variable);
      std::istringstream folders(value ? value : "");
      for (std::string folder; std::getline(folders, folder, ':');) {
        if (!folder.empty()) found.push_back(std::filesystem::path(folder) / below);
      }
    }
    found.emplace_back("/usr/share");
    return found;
  }

  std::map<std::string, std::string> texts_;
};

}  // namespace udp_bridge_roscpp

#endif  // UDP_BRIDGE_ROSCPP_DEFINITION_HPP
