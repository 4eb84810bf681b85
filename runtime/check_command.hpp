// `nadird --check`: is this package fit to fly with? Verifies it as the service does at start, remembers it in the
// aircraft's state when one is given, and says what is ready.
#pragma once

#include <filesystem>

#include "framework/command.hpp"
#include "verify_request.hpp"

namespace nadir {

class CheckCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return {}; }  // nadird has one job
  std::string_view summary() const override { return "position for the aircraft when GPS is denied"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path package_;
  VerifyRequest request_;
  bool check_ = false;
};

}  // namespace nadir
