#include "commands/sync/sync_environment.hpp"

#include <random>

namespace nadir {

std::array<std::uint8_t, 16> SyncEnvironment::system_random_bytes() {
  std::random_device device;
  std::array<std::uint8_t, 16> bytes{};
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(device());
  return bytes;
}

}  // namespace nadir
