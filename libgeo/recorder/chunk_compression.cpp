#include "recorder/chunk_compression.hpp"

#include <lz4frame.h>
#include <zlib.h>
#include <zstd.h>

#include <limits>
#include <memory>

#include "base/error.hpp"

namespace nadir {
namespace {

// Damaged bytes may promise much: memory is taken as the bytes bear it out, not at once.
constexpr std::size_t kStep = std::size_t{1} << 20;

// pull(target, target_size, done): fills some of the target; returns how much, nothing on damage; sets done at the end.
template <typename Pull>
std::optional<Bytes> gather(std::uint64_t size, const Pull& pull) {
  Bytes out;
  bool done = false;
  while (!done) {
    const std::size_t before = out.size();
    const std::size_t room = static_cast<std::size_t>(std::min<std::uint64_t>(kStep, size - before + 1));
    out.resize(before + room);
    const std::optional<std::size_t> got = pull(out.data() + before, room, done);
    if (!got) return std::nullopt;
    out.resize(before + *got);
    if (out.size() > size || (*got == 0 && !done)) return std::nullopt;
  }
  if (out.size() != size) return std::nullopt;
  return out;
}

std::optional<Bytes> unzstd(ByteView bytes, std::uint64_t size) {
  const std::unique_ptr<ZSTD_DStream, decltype(&ZSTD_freeDStream)> stream(ZSTD_createDStream(), ZSTD_freeDStream);
  ZSTD_DCtx_setParameter(stream.get(), ZSTD_d_windowLogMax, 27);
  ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
  return gather(size, [&](std::uint8_t* target, std::size_t room, bool& done) -> std::optional<std::size_t> {
    ZSTD_outBuffer out{target, room, 0};
    const std::size_t left = ZSTD_decompressStream(stream.get(), &out, &in);
    if (ZSTD_isError(left) != 0) return std::nullopt;
    done = left == 0 && in.pos == in.size;
    return out.pos;
  });
}

std::optional<Bytes> unlz4(ByteView bytes, std::uint64_t size) {
  LZ4F_dctx* made = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&made, LZ4F_VERSION)) != 0) return std::nullopt;
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(made,
                                                                                     LZ4F_freeDecompressionContext);
  return gather(size, [&](std::uint8_t* target, std::size_t room, bool& done) -> std::optional<std::size_t> {
    std::size_t written = room, taken = bytes.size();
    const std::size_t left = LZ4F_decompress(context.get(), target, &written, bytes.data(), &taken, nullptr);
    if (LZ4F_isError(left) != 0) return std::nullopt;
    bytes = bytes.subspan(taken);
    done = left == 0 && bytes.empty();
    return written;
  });
}

}  // namespace

std::uint32_t crc32_of(ByteView bytes, std::uint32_t before) {
  return static_cast<std::uint32_t>(crc32_z(before, bytes.data(), bytes.size()));
}

Bytes compress_zstd(ByteView bytes, int level) {
  Bytes out(ZSTD_compressBound(bytes.size()));
  const std::size_t size = ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), level);
  if (ZSTD_isError(size) != 0) throw Error({.what = "a chunk cannot be compressed", .found = ZSTD_getErrorName(size)});
  out.resize(size);
  return out;
}

std::optional<Bytes> decompress_chunk(std::string_view compression, ByteView bytes, std::uint64_t size) {
  if (size > kLargestChunk) return std::nullopt;
  if (compression == "zstd") return unzstd(bytes, size);
  if (compression == "lz4") return unlz4(bytes, size);
  if (!compression.empty() || bytes.size() != size) return std::nullopt;
  return Bytes(bytes.begin(), bytes.end());
}

}  // namespace nadir
