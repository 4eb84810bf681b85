// Reads any MCAP file from its beginning to its last complete record: chunked or not, compressed or not, with a summary
// or cut off anywhere. The index is not needed for that and not trusted: it is compared with what is there.
//
// Bytes are not trusted. Damage is a finding; a damaged chunk is skipped and the next one read.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "base/input_file.hpp"
#include "recorder/mcap_format.hpp"

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

// Not memory-mapped: a file that is truncated while it is read must not end the program.
class FileSource final : public ByteSource {
 public:
  explicit FileSource(const std::filesystem::path& path) : file_(path) {}  // throws Error when it is no readable file
  std::uint64_t size() const override { return file_.size(); }
  bool read(std::uint64_t offset, std::uint64_t count, Bytes& into) const override;

 private:
  InputFile file_;
};

// What is in a file apart from its messages.
struct McapContents {
  std::string profile, library;
  std::uint64_t size = 0;        // bytes
  std::uint64_t whole_size = 0;  // up to the end of the last whole record
  bool finished = false;         // with footer and final magic
  std::map<std::uint16_t, McapSchema> schemas;
  std::map<std::uint16_t, McapChannel> channels;
  std::map<std::uint16_t, std::uint64_t> messages_of;  // read, by channel
  std::uint64_t messages = 0;
  std::uint64_t chunks = 0, damaged_chunks = 0;
  std::uint64_t attachments = 0, metadata = 0;
  std::optional<std::uint64_t> first_ns, last_ns;
  Findings findings;  // recorder.format, recorder.truncated, recorder.chunk, recorder.index
};

// Called for each message in the order of the file. `contents` has its channel, and its schema if there is one.
using McapMessageHandler = std::function<void(const McapContents& contents, const McapMessage& message)>;

// where: names the file in findings.
McapContents read_mcap(const ByteSource& source, std::string_view where, const McapMessageHandler& handler);

}  // namespace nadir
