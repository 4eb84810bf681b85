// nadir cache verify: is this package what its makers signed, is it for us, and does it hold what its mission needs?
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "base/time.hpp"
#include "cli/command.hpp"
#include "commands/cache/matchability_request.hpp"
#include "verify_request/verify_request.hpp"

namespace nadir {

class CacheVerifyCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "verify"; }
  std::string_view summary() const override { return "verify a signed package before it flies"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  int report(Context& context, const Verification& verification, UtcTime at) const;

  std::filesystem::path package_;
  VerifyRequest request_;
  std::string depth_ = "quick";
  std::optional<std::filesystem::path> report_folder_;
  bool matchability_ = false;
  MatchabilityRequest matchability_request_;
};

}  // namespace nadir
