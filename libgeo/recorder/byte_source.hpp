// Bytes that are read piece by piece: a file of any size, or memory.
#pragma once

#include <cstdint>
#include <filesystem>

#include "base/bytes.hpp"

namespace nadir {

class ByteSource {
 public:
  virtual ~ByteSource() = default;
  virtual std::uint64_t size() const = 0;
  // Exactly that many bytes into `into`; false, and an empty `into`, when they are not there or cannot be read.
  virtual bool read(std::uint64_t offset, std::uint64_t count, Bytes& into) const = 0;
};

class MemorySource final : public ByteSource {
 public:
  explicit MemorySource(ByteView bytes) : bytes_(bytes) {}
  std::uint64_t size() const override { return bytes_.size(); }
  bool read(std::uint64_t offset, std::uint64_t count, Bytes& into) const override;

 private:
  ByteView bytes_;
};

// Not mapped: a file that is cut while it is read must not end the program.
class FileSource final : public ByteSource {
 public:
  explicit FileSource(const std::filesystem::path& path);  // throws Error when it cannot be opened or is no file
  ~FileSource() override;
  FileSource(const FileSource&) = delete;
  FileSource& operator=(const FileSource&) = delete;
  std::uint64_t size() const override { return size_; }
  bool read(std::uint64_t offset, std::uint64_t count, Bytes& into) const override;

 private:
  int fd_ = -1;
  std::uint64_t size_ = 0;
};

}  // namespace nadir
