// The contract of schemas/candidates.openapi.yaml as functions from request to response, without any transport.
//
// A request is looked at twice: UploadApi::admit() sees its header and says who calls and how large a body may follow,
// before a byte of that is read; UploadApi::answer() does the work.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/digest.hpp"
#include "candidates/candidate_service.hpp"
#include "http/message.hpp"

namespace nadir {

enum class UploadPath { health, reason_codes, uploads, upload, pack, complete };

struct Admission {
  UploadPath path = UploadPath::health;
  std::string upload{};                  // of the last three
  std::optional<Sha256> pack{};          // of `pack`
  const UploadClient* client = nullptr;  // null: health, which needs no token
  std::uint64_t body_bytes = 0;          // that the request announces and may have
};

// Where a path leads, which methods it has, and what its body may be.
struct UploadRoute {
  Admission admission;
  std::string_view methods;  // "GET, HEAD"
  std::uint64_t body_max = 0;
  std::string_view media{};  // of the body; empty: there is none

  bool allows(std::string_view method) const;
};

// path: without a query. Names of uploads and packs are validated by the service; here they are but parts of a path.
// nullopt: there is no such path.
std::optional<UploadRoute> upload_route(std::string_view path, std::string_view method, std::uint64_t part_max);

// What PATCH says about its part; or what is wrong with it.
std::variant<PartHeader, std::string> part_header(const ApiRequest& request);

ApiResponse later(int status, std::string type, std::string detail);  // with Retry-After

// Who may call: each token is in a file of its own, whose name is the client's.
class Clients {
 public:
  // Each "FILE", for every airframe, or "AIRFRAME=FILE"; the same file may be given for several. Throws Error, and
  // UsageError where two clients would share a name or a token.
  explicit Clients(const std::vector<std::string>& token_files);

  const UploadClient* find(std::string_view authorization) const;  // null: unknown
  std::size_t count() const { return clients_.size(); }

 private:
  std::map<Sha256, UploadClient> clients_;  // by the token's digest
};

class UploadApi {
 public:
  using Evaluate = std::function<void(const UploadClient& client, std::int64_t upload)>;

  // All must outlive this. evaluate: is called for each upload that is complete. loopback: only loopback names are
  // accepted as Host.
  UploadApi(CandidateService& service, const Clients& clients, bool loopback, Evaluate evaluate)
      : service_(service), clients_(clients), loopback_(loopback), evaluate_(std::move(evaluate)) {}

  std::variant<Admission, ApiResponse> admit(const ApiRequest& header) const;       // quick: never asks the service
  ApiResponse answer(const Admission& admission, const ApiRequest& request) const;  // any thread; never throws

 private:
  ApiResponse route(const Admission& admission, const ApiRequest& request) const;
  ApiResponse health() const;
  ApiResponse announce(const UploadClient& client, const ApiRequest& request) const;
  ApiResponse status(const UploadClient& client, const std::string& upload) const;
  ApiResponse pack(const Admission& admission, const ApiRequest& request) const;
  ApiResponse complete(const UploadClient& client, const std::string& upload) const;

  CandidateService& service_;
  const Clients& clients_;
  bool loopback_;
  Evaluate evaluate_;
};

}  // namespace nadir
