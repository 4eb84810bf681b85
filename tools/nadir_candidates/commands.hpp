// The commands of nadir-candidates: serve, status and export.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "candidates/candidate_service.hpp"
#include "cli/command.hpp"

namespace nadir {

// Runs the service.
class ServeCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "serve"; }
  std::string_view summary() const override { return "accept and evaluate candidate tiles, and let flights vote"; }
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

// What a service's catalogue holds.
class StatusCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "status"; }
  std::string_view summary() const override {
    return "count what the service holds: uploads, verdicts, promoted tiles";
  }
  std::string_view examples() const override { return "nadir-candidates status --data /srv/candidates --json"; }
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::optional<std::filesystem::path> data_;
  std::string catalogue_;
};

// Promoted tiles as imagery for the next map.
class ExportCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "export"; }
  std::string_view summary() const override { return "write the promoted tiles as imagery for `nadir cache build`"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path data_, out_;
  std::string catalogue_;
};

}  // namespace nadir
