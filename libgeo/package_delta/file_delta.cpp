#include "package_delta/file_delta.hpp"

#include <librsync.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <memory>
#include <vector>

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr std::size_t kBuffer_bytes = std::size_t{1} << 16;
constexpr int kCompressionLevel = 10;

// Small blocks find more of what has moved by less than a page of SQLite; their number is bounded.
constexpr std::size_t kLeastBlock_bytes = 128, kMostBlock_bytes = 4096;
constexpr std::uint64_t kMostSmallBlocks = std::uint64_t{1} << 21;
constexpr std::size_t kStrongSum_bytes = 16;

std::size_t block_bytes(std::uint64_t file_bytes) {
  const std::uint64_t least = std::bit_ceil(std::max<std::uint64_t>(file_bytes / kMostSmallBlocks, 1));
  return std::clamp<std::uint64_t>(least, kLeastBlock_bytes, kMostBlock_bytes);
}

[[noreturn]] void refuse(std::string found) {
  throw Error({.what = "cannot apply the difference of a file",
               .expected = "a delta of librsync, compressed by zstd",
               .found = std::move(found),
               .fix = "transfer the patch again"});
}

struct FreeJob {
  void operator()(rs_job_t* job) const { rs_job_free(job); }
};
using Job = std::unique_ptr<rs_job_t, FreeJob>;

struct FreeSignature {
  void operator()(rs_signature_t* signature) const { rs_free_sumset(signature); }
};

// From the source through the job to the sink.
void run(const Job& job, const ByteSource& source, const ByteSink& sink) {
  if (!job) throw std::bad_alloc();
  std::vector<std::uint8_t> in(kBuffer_bytes), out(kBuffer_bytes);
  rs_buffers_t buffers{};
  for (;;) {
    if (buffers.avail_in == 0 && buffers.eof_in == 0) {
      buffers.avail_in = source(in);
      buffers.next_in = reinterpret_cast<char*>(in.data());
      buffers.eof_in = buffers.avail_in == 0 ? 1 : 0;
    }
    buffers.next_out = reinterpret_cast<char*>(out.data());
    buffers.avail_out = out.size();
    const rs_result result = rs_job_iter(job.get(), &buffers);
    const std::size_t made = out.size() - buffers.avail_out;
    if (made > 0) sink(ByteView(out).first(made));
    if (result == RS_DONE) return;
    if (result != RS_BLOCKED) refuse(rs_strerror(result));
  }
}

// Digests of all blocks of a file.
std::unique_ptr<rs_signature_t, FreeSignature> signature_of(const InputFile& file) {
  Bytes text;
  run(Job(rs_sig_begin(block_bytes(file.size()), kStrongSum_bytes, RS_RK_BLAKE2_SIG_MAGIC)),
      source_of(file, 0, file.size()), [&](ByteView bytes) { text.insert(text.end(), bytes.begin(), bytes.end()); });
  rs_signature_t* loaded = nullptr;
  const Job load(rs_loadsig_begin(&loaded));
  std::size_t at = 0;
  run(
      load,
      [&](std::span<std::uint8_t> target) {
        const std::size_t size = std::min(target.size(), text.size() - at);
        std::copy_n(text.begin() + static_cast<std::ptrdiff_t>(at), size, target.begin());
        at += size;
        return size;
      },
      [](ByteView) {});
  std::unique_ptr<rs_signature_t, FreeSignature> signature(loaded);
  if (rs_build_hash_table(signature.get()) != RS_DONE) throw std::bad_alloc();
  return signature;
}

class Compressor {
 public:
  explicit Compressor(const ByteSink& sink) : sink_(sink), context_(ZSTD_createCCtx(), ZSTD_freeCCtx) {
    if (!context_) throw std::bad_alloc();
    ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_compressionLevel, kCompressionLevel);
  }
  void write(ByteView bytes) { write(bytes, ZSTD_e_continue); }
  void finish() { write({}, ZSTD_e_end); }

 private:
  void write(ByteView bytes, ZSTD_EndDirective how) {
    ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
    for (;;) {
      ZSTD_outBuffer out{buffer_.data(), buffer_.size(), 0};
      const std::size_t left = ZSTD_compressStream2(context_.get(), &out, &in, how);
      if (ZSTD_isError(left) != 0) throw Error({.what = "cannot compress", .found = ZSTD_getErrorName(left)});
      if (out.pos > 0) sink_(ByteView(buffer_).first(out.pos));
      if (how == ZSTD_e_continue ? in.pos == in.size : left == 0) return;
    }
  }

  const ByteSink& sink_;
  std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context_;
  std::vector<std::uint8_t> buffer_ = std::vector<std::uint8_t>(kBuffer_bytes);
};

// Decompresses a source: exactly one frame.
class Decompressor {
 public:
  explicit Decompressor(const ByteSource& source) : source_(source), context_(ZSTD_createDCtx(), ZSTD_freeDCtx) {
    if (!context_) throw std::bad_alloc();
  }
  std::size_t read(std::span<std::uint8_t> target) {
    ZSTD_outBuffer out{target.data(), target.size(), 0};
    while (out.pos == 0) {
      if (in_.pos == in_.size) {
        in_ = {buffer_.data(), source_(buffer_), 0};
        if (in_.size == 0 && !ended_) refuse("it is truncated");
        if (in_.size == 0) return 0;
      }
      if (ended_) refuse("bytes after its end");
      const std::size_t left = ZSTD_decompressStream(context_.get(), &out, &in_);
      if (ZSTD_isError(left) != 0) refuse(ZSTD_getErrorName(left));
      ended_ = left == 0;
    }
    return out.pos;
  }

 private:
  const ByteSource& source_;
  std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context_;
  std::vector<std::uint8_t> buffer_ = std::vector<std::uint8_t>(kBuffer_bytes);
  ZSTD_inBuffer in_{nullptr, 0, 0};
  bool ended_ = false;
};

// librsync asks for bytes of the old file. Nothing may be thrown through it.
rs_result copy_from(void* opaque, rs_long_t at, std::size_t* size, void** target) {
  const auto& file = *static_cast<const InputFile*>(opaque);
  if (at < 0 || static_cast<std::uint64_t>(at) >= file.size()) return RS_INPUT_ENDED;
  *size = std::min<std::uint64_t>(*size, file.size() - static_cast<std::uint64_t>(at));
  try {
    const std::span bytes(static_cast<std::uint8_t*>(*target), *size);
    return file.read_at(static_cast<std::uint64_t>(at), bytes) ? RS_DONE : RS_INPUT_ENDED;
  } catch (const std::exception&) {
    return RS_IO_ERROR;
  }
}

}  // namespace

ByteSource source_of(const InputFile& file, std::uint64_t at, std::uint64_t size) {
  return [&file, at, end = at + size](std::span<std::uint8_t> target) mutable {
    const std::span part = target.first(std::min<std::uint64_t>(target.size(), end - at));
    if (!file.read_at(at, part)) {
      throw Error({.what = "a file ends early",
                   .where = file.path(),
                   .expected = std::to_string(end) + " bytes",
                   .fix = "nothing may change the file meanwhile; if nothing does, it is damaged: make it again"});
    }
    at += part.size();
    return part.size();
  };
}

void make_file_delta(const InputFile* old_file, const InputFile& new_file, const ByteSink& sink) {
  rs_trace_set_level(RS_LOG_CRIT);  // messages are ours
  Compressor compressor(sink);
  const ByteSource all = source_of(new_file, 0, new_file.size());
  if (old_file != nullptr) {
    const auto signature = signature_of(*old_file);
    run(Job(rs_delta_begin(signature.get())), all, [&](ByteView bytes) { compressor.write(bytes); });
  } else {
    std::vector<std::uint8_t> buffer(kBuffer_bytes);
    while (const std::size_t size = all(buffer)) compressor.write(ByteView(buffer).first(size));
  }
  compressor.finish();
}

void apply_file_delta(const InputFile* old_file, const ByteSource& delta, const ByteSink& sink) {
  rs_trace_set_level(RS_LOG_CRIT);
  Decompressor decompressor(delta);
  const ByteSource all = [&](std::span<std::uint8_t> target) { return decompressor.read(target); };
  if (old_file != nullptr) {
    run(Job(rs_patch_begin(copy_from, const_cast<InputFile*>(old_file))), all, sink);
    std::array<std::uint8_t, 1> more{};
    if (all(more) > 0) refuse("bytes after its end");
  } else {
    std::vector<std::uint8_t> buffer(kBuffer_bytes);
    while (const std::size_t size = all(buffer)) sink(ByteView(buffer).first(size));
  }
}

}  // namespace nadir
