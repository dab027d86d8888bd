// SPDX-License-Identifier: Apache-2.0
// A stub: packages lie below the folder SHARE of the environment.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>

namespace ament_index_cpp {

inline std::string get_package_share_directory(const std::string& package) {
  const std::filesystem::path folder = std::filesystem::path(std::getenv("SHARE")) / package;
  if (!std::filesystem::exists(folder)) throw std::runtime_error("package not found: " + package);
  return folder;
}

}  // namespace ament_index_cpp
