// What a request's first line and headers ask for. Pure text work on what anybody may have sent.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/sha256.hpp"
#include "candidates/candidate_service.hpp"
#include "http/message.hpp"

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

// The candidate service's answers as documents of schemas/candidates.openapi.yaml.

ApiResponse announcement_answer(const Announcement& announcement, std::uint64_t part_max);
ApiResponse completion_answer(const Completion& completion);
ApiResponse status_answer(const UploadStatus& status);
ApiResponse reason_codes_answer();
ApiResponse health_answer(const std::string& trouble, bool fails);
ApiResponse denial_answer(const Denial& denial);
ApiResponse later(int status, std::string type, std::string detail);  // with Retry-After

// Who may call: each token stands in a file of its own, whose name is the client's.

class Clients {
 public:
  // Each "FILE", for every airframe, or "AIRFRAME=FILE"; the same file may be given for several. Throws Error, and
  // UsageError where two clients would share a name or a token.
  explicit Clients(const std::vector<std::string>& token_files);

  const UploadClient* find(std::string_view authorization) const;  // null: nobody's
  std::size_t count() const { return clients_.size(); }

 private:
  std::map<Sha256, UploadClient> clients_;  // by the token's digest
};

// The contract of schemas/candidates.openapi.yaml as functions from request to answer, without any transport.
//
// A request is looked at twice: admit() sees its header and says who calls and how large a body may follow, before a
// byte of that is read; answer() does the work.

class UploadApi {
 public:
  using Judge = std::function<void(const UploadClient& client, std::int64_t upload)>;

  // All must outlive this. judge: is told of each upload that is complete. loopback: only names of this machine are
  // taken for its own.
  UploadApi(CandidateService& service, const Clients& clients, bool loopback, Judge judge)
      : service_(service), clients_(clients), loopback_(loopback), judge_(std::move(judge)) {}

  std::variant<Admission, ApiResponse> admit(const UploadRequest& header) const;       // quick: never asks the service
  ApiResponse answer(const Admission& admission, const UploadRequest& request) const;  // any thread; never throws

 private:
  ApiResponse route(const Admission& admission, const UploadRequest& request) const;
  ApiResponse health() const;
  ApiResponse announce(const UploadClient& client, const UploadRequest& request) const;
  ApiResponse status(const UploadClient& client, const std::string& upload) const;
  ApiResponse pack(const Admission& admission, const UploadRequest& request) const;
  ApiResponse complete(const UploadClient& client, const std::string& upload) const;

  CandidateService& service_;
  const Clients& clients_;
  bool loopback_;
  Judge judge_;
};

}  // namespace nadir
