// SPDX-License-Identifier: Apache-2.0
// A stub: a type is installed where its definition is.
#pragma once

#include <ament_index_cpp/get_package_share_directory.hpp>

#include <memory>
#include <string>

namespace rcpputils {
class SharedLibrary {};
}  // namespace rcpputils

namespace rclcpp {

inline std::shared_ptr<rcpputils::SharedLibrary> get_typesupport_library(const std::string& type,
                                                                         const std::string&) {
  const std::size_t slash = type.find('/');
  const std::string folder = ament_index_cpp::get_package_share_directory(type.substr(0, slash));
  if (!std::filesystem::exists(folder + type.substr(slash) + ".msg")) {
    throw std::runtime_error("no type " + type);
  }
  return nullptr;
}

}  // namespace rclcpp
