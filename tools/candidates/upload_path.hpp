// What a request's first line and headers ask for. Pure text work on what anybody may have sent.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "base/digest.hpp"
#include "candidates/service_result.hpp"

namespace nadir {

struct UploadRequest {
  std::string method{}, target{}, host{}, authorization{}, content_type{};
  std::optional<std::uint64_t> content_length{};
  bool other_encoding = false;  // Transfer-Encoding or Content-Encoding
  std::optional<std::string> idempotency_key{}, upload_offset{}, upload_length{}, content_digest{};
  std::string body{};
};

enum class UploadPath { health, reason_codes, uploads, upload, pack, complete };

struct Admission {
  UploadPath path = UploadPath::health;
  std::string upload{};                  // of the last three
  std::optional<Sha256> pack{};          // of `pack`
  const UploadClient* client = nullptr;  // null: health, which nobody's token is asked for
  std::uint64_t body_bytes = 0;          // that the request announces and may have
};

// Where a path leads, which methods it has, and what its body may be.
struct UploadWay {
  Admission admission;
  std::string_view methods;  // "GET, HEAD"
  std::uint64_t body_max = 0;
  std::string_view media{};  // of the body; empty: there is none
};

// path: without a query. Names of uploads and packs are looked at again by the service; here they are but parts of a
// path. nullopt: there is no such path.
std::optional<UploadWay> way_of(std::string_view path, std::string_view method, std::uint64_t part_max);

bool lists(std::string_view methods, std::string_view method);

// "application/json; charset=utf-8" as "application/json"
std::string media_type(std::string_view text);

// What PATCH says about its part; or what is wrong with it.
std::variant<PartHeader, std::string> part_header(const UploadRequest& request);

}  // namespace nadir
