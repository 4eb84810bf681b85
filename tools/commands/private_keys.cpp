#include "commands/private_keys.hpp"

namespace nadir {

std::vector<PrivateKey> read_private_keys(std::span<const std::filesystem::path> files) {
  std::vector<PrivateKey> keys;
  for (const auto& file : files) keys.push_back(PrivateKey::read(file));
  return keys;
}

std::vector<const PrivateKey*> pointers_to(const std::vector<PrivateKey>& keys) {
  std::vector<const PrivateKey*> pointers;
  for (const PrivateKey& key : keys) pointers.push_back(&key);
  return pointers;
}

}  // namespace nadir
