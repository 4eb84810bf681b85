// Ranged reads of objects by HTTP (RFC 9110, section 14): libcurl, with every wait, every answer and every redirection
// bounded.
//
// A server is not trusted. What it sends is accepted only as the very range that was asked for, and what it means is
// judged by the reader (pinned_object.hpp). It may lead elsewhere only from web server to web server: by http and https
// alone, never from https to http, and never to a link-local address, where machines in a cloud keep their credentials.
//
// Requests to object storage are signed URLs. The signer comes from outside; raster/pinned_files.hpp takes GDAL's.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "object_storage/object_address.hpp"

namespace nadir {

struct CurlHandle;  // http/curl.hpp

// The URL to GET an object of a store with, valid for some minutes. Throws Error without credentials.
using SignUrl = std::function<std::string(const ObjectAddress&)>;

struct ObjectClientSettings {
  std::optional<std::filesystem::path> authorities{};  // PEM file in the place of the system's
  int connect_timeout_s = 10;
  int stall_timeout_s = 20;     // so long below ...
  int slowest_bytes_s = 4096;   // ... counts as no answer
  int request_timeout_s = 300;  // a whole answer
  int attempts = 4;             // in all, when there was none, or the server was busy
  int first_delay_ms = 500;     // before the second; doubled each time
};

struct ObjectPart {
  Bytes bytes;
  std::uint64_t object_bytes = 0;  // size of the whole object, as the server states it
  std::string etag;                // the server's name for this version of it; may be empty
};

// What was asked of all servers together, for benchmarks and messages.
struct ObjectTraffic {
  std::uint64_t requests = 0;
  std::uint64_t bytes = 0;  // of bodies
};

// The header Content-Range, "bytes 0-1023/146515". Nothing for other forms, an unknown size among them.
struct ContentRange {
  std::uint64_t first = 0, last = 0, size = 0;
};
std::optional<ContentRange> parse_content_range(std::string_view text);

class ObjectClient {
 public:
  ObjectClient(SignUrl sign, ObjectClientSettings settings = {});
  ~ObjectClient();

  // Bytes [at, at + most) of the object, fewer at its end; at lies within it. Throws Error when there is no such
  // object, no permission, no answer, or another answer.
  ObjectPart read(const ObjectAddress& object, std::uint64_t at, std::uint64_t most);

  ObjectTraffic traffic() const { return {requests_, bytes_}; }

 private:
  struct Attempt;
  Attempt attempt(const ObjectAddress& object, std::uint64_t at, std::uint64_t most);
  std::unique_ptr<CurlHandle> take_connection();
  void give_back(std::unique_ptr<CurlHandle> connection);

  SignUrl sign_;
  ObjectClientSettings settings_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<CurlHandle>> idle_;
  std::atomic<std::uint64_t> requests_ = 0, bytes_ = 0;
};

}  // namespace nadir
