// The secret that a link is signed with: 32 bytes, known to the autopilot, its operators and us. It never enters a log,
// a record or an error text, and is wiped from memory when it goes.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>

namespace nadir {

class SigningKey {
 public:
  // A file with 64 hexadecimal digits, mode 0600 or narrower. Throws UsageError, Error.
  static SigningKey read(const std::filesystem::path& path);
  static SigningKey generate();  // from the operating system's randomness

  explicit SigningKey(const std::array<std::uint8_t, 32>& bytes) : bytes_(bytes) {}
  ~SigningKey();
  SigningKey(const SigningKey&) = default;
  SigningKey& operator=(const SigningKey&) = default;

  // Refuses to replace a file, which may hold a key that an autopilot still asks for.
  void write(const std::filesystem::path& path) const;

  const std::array<std::uint8_t, 32>& bytes() const { return bytes_; }

 private:
  std::array<std::uint8_t, 32> bytes_;
};

}  // namespace nadir
