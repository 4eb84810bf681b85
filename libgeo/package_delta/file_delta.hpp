// The difference of two files as a stream of bytes: what makes the new file of the old one. Tiles that did not change
// are copied from the old file wherever they lie in it now, so that the stream is about as large as what is new.
//
// The stream is a delta of librsync (rsync's algorithm: blocks of the old file are found at any offset of the new one
// by a rolling checksum and BLAKE2), compressed by zstd. Without an old file it is the new file, compressed.
// Memory: some 30 bytes for each block of the old file when it is made, 200 kB when it is applied.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "base/bytes.hpp"
#include "base/input_file.hpp"

namespace nadir {

using ByteSink = std::function<void(ByteView)>;
// Fills some of the target; 0: the end.
using ByteSource = std::function<std::size_t(std::span<std::uint8_t>)>;

// The first `size` bytes from there. Throws Error when the file ends before.
ByteSource source_of(const InputFile& file, std::uint64_t at, std::uint64_t size);

// old: null without one. Throws what the sink throws, Error when a file cannot be read.
void make_file_delta(const InputFile* old_file, const InputFile& new_file, const ByteSink& sink);

// What it makes is as good as the old file and the stream are: compare its digest. Throws Error when the stream is no
// such difference or refers to bytes that the old file does not have.
void apply_file_delta(const InputFile* old_file, const ByteSource& delta, const ByteSink& sink);

}  // namespace nadir
