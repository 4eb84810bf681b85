// nadir-candidates serve: the service.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "candidates/candidate_service.hpp"
#include "cli/command.hpp"

namespace nadir {

class ServeCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "serve"; }
  std::string_view summary() const override { return "take candidate tiles, judge them and let flights vote"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  void complete_rules();

  CandidateServiceOptions service_;
  std::filesystem::path data_;
  std::string catalogue_;
  std::string listen_ = "127.0.0.1:8760";
  std::vector<std::string> token_files_;
  std::optional<std::filesystem::path> port_file_;
  int threads_ = 2;
  int max_age_days_ = 90;
  int quota_mb_ = 8192;
  int keep_free_mb_ = 1024;
  std::string independent_ = "days";
};

}  // namespace nadir
