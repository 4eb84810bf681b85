#include "base/private_file.hpp"

#include <sys/stat.h>

#include <cerrno>
#include <cstdio>

#include "base/error.hpp"

namespace nadir {

void require_private_mode(const std::filesystem::path& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) {
    throw Error({.what = "cannot open a key", .where = path, .found = system_error_text(errno)});
  }
  if ((info.st_mode & 07177) != 0) {
    char mode[8];
    std::snprintf(mode, sizeof mode, "%04o", static_cast<unsigned>(info.st_mode & 07777));
    throw UsageError({.what = "others than its owner may use this private key file",
                      .where = path,
                      .expected = "mode 0600 or narrower",
                      .found = std::string("mode ") + mode,
                      .fix = "chmod 600 " + path.string()});
  }
}

}  // namespace nadir
