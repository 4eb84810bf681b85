#include "imagery/sqlite_input.hpp"

#include <fmt/format.h>
#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <new>
#include <utility>
#include <vector>

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr std::size_t kPiece_bytes = 1 << 16;

// Limits of what the connection may spill into temporary files.
struct WorkingMemory {
  std::uint64_t limit = 0;
  std::atomic<std::uint64_t> used = 0;
  std::atomic<bool> spent = false;
};

// A temporary file in memory, in blocks.
class WorkingFile {
 public:
  explicit WorkingFile(WorkingMemory& memory) : memory_(memory) {}
  ~WorkingFile() { truncate(0); }
  WorkingFile(const WorkingFile&) = delete;
  WorkingFile& operator=(const WorkingFile&) = delete;

  std::uint64_t size() const { return size_; }

  // Returns the number of bytes read.
  std::size_t read(std::uint64_t at, std::uint8_t* target, std::size_t wanted) const {
    if (at >= size_) return 0;
    const auto there = static_cast<std::size_t>(std::min<std::uint64_t>(wanted, size_ - at));
    for (std::size_t have = 0; have < there;) {
      const std::size_t inside = (at + have) % kPiece_bytes;
      const std::size_t count = std::min(there - have, kPiece_bytes - inside);
      std::memcpy(target + have, pieces_[(at + have) / kPiece_bytes]->data() + inside, count);
      have += count;
    }
    return there;
  }

  bool write(std::uint64_t at, const std::uint8_t* from, std::size_t count) {
    if (!reserve(at + count)) return false;
    for (std::size_t done = 0; done < count;) {
      const std::size_t inside = (at + done) % kPiece_bytes;
      const std::size_t part = std::min(count - done, kPiece_bytes - inside);
      std::memcpy(pieces_[(at + done) / kPiece_bytes]->data() + inside, from + done, part);
      done += part;
    }
    size_ = std::max(size_, at + count);
    return true;
  }

  void truncate(std::uint64_t size) {
    size_ = std::min(size_, size);
    const std::size_t kept = (size_ + kPiece_bytes - 1) / kPiece_bytes;
    memory_.used -= (pieces_.size() - std::min(kept, pieces_.size())) * kPiece_bytes;
    if (kept < pieces_.size()) pieces_.resize(kept);
  }

 private:
  using Piece = std::array<std::uint8_t, kPiece_bytes>;

  bool reserve(std::uint64_t size) {
    const std::uint64_t wanted = (size + kPiece_bytes - 1) / kPiece_bytes;
    if (wanted <= pieces_.size()) return true;
    const std::uint64_t more = (wanted - pieces_.size()) * kPiece_bytes;
    if (more > memory_.limit || memory_.used > memory_.limit - more) {
      memory_.spent = true;
      return false;
    }
    while (pieces_.size() < wanted) {
      pieces_.push_back(std::make_unique<Piece>());
      memory_.used += kPiece_bytes;
    }
    return true;
  }

  WorkingMemory& memory_;
  std::vector<std::unique_ptr<Piece>> pieces_;
  std::uint64_t size_ = 0;
};

}  // namespace

struct SqliteInput::Impl {
  Impl(InputFile input, std::uint64_t working_bytes) : file(std::move(input)) { memory.limit = working_bytes; }

  InputFile file;
  WorkingMemory memory;
  std::string name;
  sqlite3_vfs vfs{};
};

namespace {

// SQLite allocates these by szOsFile and accesses only their first member.
struct OpenFile {
  sqlite3_file base{};
  const InputFile* input = nullptr;  // the database, or:
  WorkingFile* working = nullptr;
};

OpenFile& opened(sqlite3_file* file) { return *reinterpret_cast<OpenFile*>(file); }
SqliteInput::Impl& input_of(sqlite3_vfs* vfs) { return *static_cast<SqliteInput::Impl*>(vfs->pAppData); }

int close_file(sqlite3_file* file) {
  delete std::exchange(opened(file).working, nullptr);
  return SQLITE_OK;
}

int read_file_at(sqlite3_file* file, void* target, int size, sqlite3_int64 at) {
  const OpenFile& from = opened(file);
  auto* bytes = static_cast<std::uint8_t*>(target);
  const auto wanted = static_cast<std::size_t>(size);
  std::size_t there = 0;
  if (from.working != nullptr) {
    there = from.working->read(static_cast<std::uint64_t>(at), bytes, wanted);
  } else {
    const std::uint64_t end = from.input->size(), begin = std::min(static_cast<std::uint64_t>(at), end);
    there = static_cast<std::size_t>(std::min<std::uint64_t>(wanted, end - begin));
    try {
      if (!from.input->read_at(begin, {bytes, there})) return SQLITE_IOERR_READ;  // truncated meanwhile
    } catch (const Error&) {
      return SQLITE_IOERR_READ;
    }
  }
  if (there == wanted) return SQLITE_OK;
  std::memset(bytes + there, 0, wanted - there);  // as SQLite asks
  return SQLITE_IOERR_SHORT_READ;
}

int write_file_at(sqlite3_file* file, const void* from, int size, sqlite3_int64 at) {
  const OpenFile& to = opened(file);
  if (to.working == nullptr) return SQLITE_READONLY;
  try {
    const bool written = to.working->write(static_cast<std::uint64_t>(at), static_cast<const std::uint8_t*>(from),
                                           static_cast<std::size_t>(size));
    return written ? SQLITE_OK : SQLITE_FULL;
  } catch (const std::bad_alloc&) {
    return SQLITE_NOMEM;
  }
}

int truncate_file(sqlite3_file* file, sqlite3_int64 size) {
  if (opened(file).working == nullptr) return SQLITE_READONLY;
  opened(file).working->truncate(static_cast<std::uint64_t>(size));
  return SQLITE_OK;
}

int sync_file(sqlite3_file*, int) { return SQLITE_OK; }

int size_of_file(sqlite3_file* file, sqlite3_int64* size) {
  const OpenFile& of = opened(file);
  *size = static_cast<sqlite3_int64>(of.working != nullptr ? of.working->size() : of.input->size());
  return SQLITE_OK;
}

int lock_file(sqlite3_file*, int) { return SQLITE_OK; }
int no_other_lock(sqlite3_file*, int* locked) {
  *locked = 0;
  return SQLITE_OK;
}
int no_control(sqlite3_file*, int, void*) { return SQLITE_NOTFOUND; }
int sector_size(sqlite3_file*) { return 4096; }
int characteristics(sqlite3_file* file) { return opened(file).working == nullptr ? SQLITE_IOCAP_IMMUTABLE : 0; }

constexpr sqlite3_io_methods kMethods{1,          close_file,   read_file_at,    write_file_at, truncate_file,
                                      sync_file,  size_of_file, lock_file,       lock_file,     no_other_lock,
                                      no_control, sector_size,  characteristics, nullptr,       nullptr,
                                      nullptr,    nullptr,      nullptr,         nullptr};

int open_file(sqlite3_vfs* vfs, const char*, sqlite3_file* file, int flags, int* opened_with) {
  auto* made = new (file) OpenFile{};  // pMethods null: nothing to close when this fails
  SqliteInput::Impl& input = input_of(vfs);
  if ((flags & SQLITE_OPEN_MAIN_DB) != 0) {
    made->input = &input.file;
    if (opened_with != nullptr) *opened_with = SQLITE_OPEN_READONLY;
  } else if ((flags & SQLITE_OPEN_DELETEONCLOSE) != 0) {
    made->working = new (std::nothrow) WorkingFile(input.memory);
    if (made->working == nullptr) return SQLITE_NOMEM;
    if (opened_with != nullptr) *opened_with = flags;
  } else {
    return SQLITE_CANTOPEN;
  }
  made->base.pMethods = &kMethods;
  return SQLITE_OK;
}

int delete_nothing(sqlite3_vfs*, const char*, int) { return SQLITE_OK; }
int nothing_there(sqlite3_vfs*, const char*, int, int* there) {
  *there = 0;
  return SQLITE_OK;
}
int keep_name(sqlite3_vfs*, const char* name, int room, char* out) {
  sqlite3_snprintf(room, out, "%s", name);
  return SQLITE_OK;
}

}  // namespace

SqliteInput::SqliteInput(InputFile file, std::uint64_t working_bytes)
    : impl_(std::make_unique<Impl>(std::move(file), working_bytes)) {
  impl_->name = fmt::format("nadir-input-{}", static_cast<const void*>(impl_.get()));
  const sqlite3_vfs* system = sqlite3_vfs_find(nullptr);
  if (system == nullptr) throw Error({.what = "SQLite cannot be started"});
  sqlite3_vfs& vfs = impl_->vfs;
  vfs.iVersion = 1;
  vfs.szOsFile = sizeof(OpenFile);
  vfs.mxPathname = 4096;
  vfs.zName = impl_->name.c_str();
  vfs.pAppData = impl_.get();
  vfs.xOpen = open_file;
  vfs.xDelete = delete_nothing;
  vfs.xAccess = nothing_there;
  vfs.xFullPathname = keep_name;
  vfs.xRandomness = system->xRandomness;
  vfs.xSleep = system->xSleep;
  vfs.xCurrentTime = system->xCurrentTime;
}

SqliteInput::~SqliteInput() = default;

int SqliteInput::open(sqlite3** handle) const {
  // The registry is asked for a VFS by its name once, when a connection is opened; the connection keeps the pointer.
  if (sqlite3_vfs_register(&impl_->vfs, 0) != SQLITE_OK) return SQLITE_NOMEM;
  const int code = sqlite3_open_v2("file:/input?mode=ro&immutable=1", handle, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI,
                                   impl_->name.c_str());
  sqlite3_vfs_unregister(&impl_->vfs);
  return code;
}

const InputFile& SqliteInput::file() const { return impl_->file; }
bool SqliteInput::working_memory_spent() const { return impl_->memory.spent; }

}  // namespace nadir
