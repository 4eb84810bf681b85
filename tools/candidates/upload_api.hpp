// The contract of schemas/candidates.openapi.yaml as functions from request to answer, without any transport.
//
// A request is looked at twice: admit() sees its header and says who calls and how large a body may follow, before a
// byte of that is read; answer() does the work.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "candidates/candidate_service.hpp"
#include "candidates/clients.hpp"
#include "candidates/upload_path.hpp"
#include "http/problem.hpp"

namespace nadir {

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
