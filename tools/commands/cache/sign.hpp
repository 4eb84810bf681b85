// nadir cache sign: signs a package that was built without a key, or adds a second signature.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "cli/command.hpp"

namespace nadir {

class CacheSignCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "sign"; }
  std::string_view summary() const override { return "sign a package, or add a signature to it"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path package_;
  std::vector<std::filesystem::path> keys_;
  std::vector<std::filesystem::path> roots_;
  bool only_ = false;
};

}  // namespace nadir
