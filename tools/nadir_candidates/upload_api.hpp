// The contract of schemas/candidates.openapi.yaml as functions from request to response, without any transport.
//
// A request is looked at twice: UploadApi::admit() sees its header and says who calls and how large a body may follow,
// before a byte of that is read; UploadApi::answer() does the work.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/digest.hpp"
#include "candidates/candidate_service.hpp"
#include "http/message.hpp"
#include "nadir_candidates/access_tokens.hpp"

namespace nadir {

enum class UploadPath { health, reason_codes, uploads, upload, pack, complete, installed };

struct Admission {
  UploadPath path = UploadPath::health;
  std::string upload{};                             // of the last three
  std::optional<Sha256> pack{};                     // of `pack`
  std::shared_ptr<const Clients::Client> caller{};  // null: health, which needs no token
  std::uint64_t body_bytes = 0;                     // that the request announces and may have

  const UploadClient& client() const { return caller->client; }
};

// Where a path leads, which methods it has, and what its body may be.
struct UploadRoute {
  Admission admission;
  std::string_view methods;  // "GET, HEAD"
  std::uint64_t body_max = 0;
  std::string_view media{};           // of the body; empty: there is none
  std::optional<TokenScope> scope{};  // that a token needs; none: any known token will do

  bool allows(std::string_view method) const;
};

// path: without a query. Names of uploads and packs are validated by the service; here they are but parts of a path.
// nullopt: there is no such path.
std::optional<UploadRoute> upload_route(std::string_view path, std::string_view method, std::uint64_t part_max);

// What PATCH says about its part; or what is wrong with it.
std::variant<PartHeader, std::string> part_header(const ApiRequest& request);

// An aircraft's last report, as GET /v1/installed and `nadir-candidates installed --json` list it.
nlohmann::json installed_json(const InstalledStore::Entry& entry);

ApiResponse later(int status, std::string type, std::string detail);  // with Retry-After

class UploadApi {
 public:
  using Evaluate = std::function<void()>;

  // The first two must outlive this. evaluate: is called when an upload is complete. loopback: only loopback
  // names are accepted as Host. notes: on how the service was started, for its health.
  UploadApi(CandidateService& service, const Clients& clients, bool loopback, Evaluate evaluate,
            std::vector<std::string> notes = {})
      : service_(service),
        clients_(clients),
        loopback_(loopback),
        evaluate_(std::move(evaluate)),
        notes_(std::move(notes)) {}

  std::variant<Admission, ApiResponse> admit(const ApiRequest& header) const;       // quick: never asks the service
  ApiResponse answer(const Admission& admission, const ApiRequest& request) const;  // any thread; never throws

 private:
  ApiResponse route(const Admission& admission, const ApiRequest& request) const;
  ApiResponse health() const;
  ApiResponse announce(const UploadClient& client, const ApiRequest& request) const;
  ApiResponse status(const UploadClient& client, const std::string& upload) const;
  ApiResponse pack(const Admission& admission, const ApiRequest& request) const;
  ApiResponse complete(const UploadClient& client, const std::string& upload) const;
  ApiResponse report_installed(const UploadClient& client, const ApiRequest& request) const;
  ApiResponse installed() const;
  ApiResponse not_admitted(const Clients::Client* caller, const UploadRoute* route, const ApiRequest& header) const;

  CandidateService& service_;
  const Clients& clients_;
  bool loopback_;
  Evaluate evaluate_;
  std::vector<std::string> notes_;
};

}  // namespace nadir
