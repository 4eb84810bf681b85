#include "service/held_memory.hpp"

#include <fmt/format.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include <cstdlib>
#include <cstring>
#include <vector>

#include "base/error.hpp"
#include "base/platform.hpp"

namespace nadir {

void hold_memory([[maybe_unused]] std::size_t megabytes) {
#ifdef __GLIBC__
  if (megabytes == 0) return;
  constexpr std::size_t kPiece = std::size_t{8} << 20;  // below the largest size that the heap serves
  ::mallopt(M_ARENA_MAX, 1);
  keep_freed_memory();
  std::vector<void*> pieces((megabytes * (std::size_t{1} << 20) + kPiece - 1) / kPiece);
  bool enough = true;
  for (void*& piece : pieces) {
    piece = std::malloc(kPiece);
    enough = enough && piece != nullptr;
    // Not zeros: the compiler might turn it into calloc(), which would leave the pages unmapped.
    if (piece != nullptr) std::memset(piece, 0x5a, kPiece);
  }
  for (void* piece : pieces) std::free(piece);
  if (enough) return;
  throw Error({.what = "not enough memory for a flight",
               .where = "--memory-mb",
               .expected = fmt::format("{} MB", megabytes),
               .found = "the system cannot provide that much",
               .fix = "stop other programs, or lower --memory-mb"});
#endif
}

}  // namespace nadir
