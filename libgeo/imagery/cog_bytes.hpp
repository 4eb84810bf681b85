// Bytes at places, as a reader of TIFF wants them: from a file (positional reads; not mapped, because a file that is
// cut short while an aircraft flies must be an error and no signal) or from memory.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>

#include "base/bytes.hpp"

namespace nadir {

class RandomBytes {
 public:
  virtual ~RandomBytes() = default;
  virtual std::uint64_t size() const = 0;
  // Fills the target. False when the bytes are not all there. Throws CogError when the medium fails.
  virtual bool read(std::uint64_t at, std::span<std::uint8_t> target) const = 0;
};

class FileBytes final : public RandomBytes {
 public:
  explicit FileBytes(std::filesystem::path path);  // throws Error when it is missing or no regular file
  ~FileBytes() override;
  FileBytes(const FileBytes&) = delete;
  FileBytes& operator=(const FileBytes&) = delete;

  std::uint64_t size() const override { return size_; }  // when it was opened
  bool read(std::uint64_t at, std::span<std::uint8_t> target) const override;

 private:
  std::filesystem::path path_;
  std::uint64_t size_ = 0;
  int fd_ = -1;
};

class MemoryBytes final : public RandomBytes {
 public:
  explicit MemoryBytes(ByteView bytes) : bytes_(bytes) {}  // outlives this
  std::uint64_t size() const override { return bytes_.size(); }
  bool read(std::uint64_t at, std::span<std::uint8_t> target) const override;

 private:
  ByteView bytes_;
};

}  // namespace nadir
