#include "service/state_directory.hpp"

#include <exception>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t kMaxSize = 1 << 16;

}  // namespace

StateDirectory::StateDirectory(fs::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error || !fs::is_directory(folder_)) {
    throw Error({.what = "cannot use the state directory",
                 .where = folder_,
                 .expected = "a folder that can be written",
                 .found = error ? error.message() : "no folder",
                 .fix = "give --state a folder of the service's own"});
  }
  for (const auto& entry : fs::directory_iterator(folder_)) {
    if (entry.path().filename().string().starts_with("flight.json.tmp")) fs::remove(entry.path(), error);
  }
  write_file_atomic(folder_ / ".writable", "");
  fs::remove(folder_ / ".writable", error);
}

std::optional<std::string> StateDirectory::save(const SavedFlight& flight) const {
  try {
    write_file_atomic(file(), to_text(flight));
    return std::nullopt;
  } catch (const std::exception& error) {
    return error.what();
  }
}

SavedFlightReading StateDirectory::load() const {
  std::error_code ignored;
  if (!fs::exists(fs::symlink_status(file(), ignored))) return {std::nullopt, "nothing was saved"};
  try {
    return parse_saved_flight(read_text_file(file(), kMaxSize));
  } catch (const Error& error) {
    return {std::nullopt, error.what()};
  }
}

}  // namespace nadir
