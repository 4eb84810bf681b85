#include "nadir_candidates/upload_server.hpp"

#include <limits>
#include <map>
#include <mutex>
#include <string>
#include <utility>

#include "http/server.hpp"

namespace nadir {
namespace {

class ClientShares {
 public:
  explicit ClientShares(const ShareLimits& limits) : limits_(limits) {}

  bool take(const std::string& client, std::uint64_t bytes) {
    const std::lock_guard lock(mutex_);
    Share& share = shares_[client];
    if (share.requests >= limits_.client_requests || share.bytes + bytes > limits_.client_bodies_bytes ||
        total_bytes_ + bytes > limits_.bodies_bytes) {
      return false;
    }
    ++share.requests;
    share.bytes += bytes;
    total_bytes_ += bytes;
    return true;
  }

  void give_back(const std::string& client, std::uint64_t bytes) {
    const std::lock_guard lock(mutex_);
    Share& share = shares_[client];
    --share.requests;
    share.bytes -= bytes;
    total_bytes_ -= bytes;
  }

 private:
  struct Share {
    std::size_t requests = 0;
    std::uint64_t bytes = 0;
  };
  ShareLimits limits_;
  std::mutex mutex_;
  std::uint64_t total_bytes_ = 0;
  std::map<std::string, Share> shares_;  // as many as there are tokens
};

// Holds its client's share until the response is written.
struct UploadAdmission final : HttpAdmission {
  UploadAdmission(Admission from, ClientShares& client_shares) : admission(std::move(from)), shares(client_shares) {
    busy = admission.caller != nullptr;
    body_bytes = admission.body_bytes;
  }
  ~UploadAdmission() override {
    if (has_share) shares.give_back(admission.client().name, admission.body_bytes);
  }
  UploadAdmission(const UploadAdmission&) = delete;
  UploadAdmission& operator=(const UploadAdmission&) = delete;

  bool take_share() { return has_share = shares.take(admission.client().name, admission.body_bytes); }

  const Admission admission;
  ClientShares& shares;
  bool has_share = false;
};

class UploadHandler final : public HttpHandler {
 public:
  UploadHandler(const UploadApi& api, FairQueue& queue, const ShareLimits& limits)
      : api_(api), queue_(queue), shares_(limits) {}

  std::variant<std::shared_ptr<HttpAdmission>, ApiResponse> admit(const ApiRequest& header) const override {
    auto admitted = api_.admit(header);
    if (auto* refusal = std::get_if<ApiResponse>(&admitted)) return std::move(*refusal);
    auto admission = std::make_shared<UploadAdmission>(std::move(std::get<Admission>(admitted)), shares_);
    if (admission->busy && !admission->take_share()) {
      return later(429, "too-many-requests", "too many requests at a time, or too large ones");
    }
    return admission;
  }

  void serve(ApiRequest request, const HttpAdmission& admitted, const ServerCounts&, Respond respond) const override {
    const Admission& admission = static_cast<const UploadAdmission&>(admitted).admission;
    const std::string lane = admission.caller == nullptr ? "anybody" : "client " + admission.client().name;
    const auto shared = std::make_shared<ApiRequest>(std::move(request));
    const bool taken = queue_.put(lane, [this, shared, respond, &admission]() mutable {
      ApiResponse response = api_.answer(admission, *shared);
      std::exchange(respond, nullptr)(std::move(response));  // with it goes the connection
    });
    if (!taken) respond(later(429, "too-many-requests", "too many requests at a time"));
  }

  void on_stopped() const override { queue_.stop(); }

 private:
  const UploadApi& api_;
  FairQueue& queue_;
  mutable ClientShares shares_;
};

HttpLimits http_limits(const UploadServerLimits& limits) {
  return {.header_bytes = limits.header_bytes,
          .body_bytes = std::numeric_limits<std::uint64_t>::max(),  // admit() decides, before a byte is read
          .connections = limits.connections,
          .request_time = limits.header_time,
          .body_time = limits.body_time,
          .slowest_bytes_s = limits.slowest_bytes_s,
          .answer_time = limits.answer_time,
          .linger_time = limits.linger_time};
}

}  // namespace

struct UploadServer::Impl {
  Impl(const UploadApi& api, FairQueue& queue, const ListenAddress& address, const UploadServerLimits& limits)
      : handler(api, queue, limits.shares), server(handler, address, http_limits(limits)) {}

  UploadHandler handler;
  HttpServer server;
};

UploadServer::UploadServer(const UploadApi& api, FairQueue& queue, const ListenAddress& address,
                           const UploadServerLimits& limits)
    : impl_(std::make_unique<Impl>(api, queue, address, limits)) {}

UploadServer::~UploadServer() = default;

std::uint16_t UploadServer::port() const { return impl_->server.port(); }

}  // namespace nadir
