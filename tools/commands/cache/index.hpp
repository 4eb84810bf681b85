// nadir cache index: adds a place index to a package, or asks the one that is there how good it is.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "package/manifest.hpp"

namespace nadir {

class CacheIndexCommand final : public Command {
 public:
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "index"; }
  std::string_view summary() const override { return "add a place index to a package, for cold starts"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  int make(Context& context, const Manifest& manifest, const Mission& mission) const;
  int evaluate(Context& context, const Manifest& manifest, const Mission& mission) const;
  std::vector<double> footprints_m(const Mission& mission) const;

  std::filesystem::path package_;
  std::optional<std::filesystem::path> key_;
  std::optional<std::filesystem::path> camera_;
  std::vector<double> agl_m_;
  std::vector<double> footprints_m_;
  std::optional<double> gsd_m_;
  int overlap_percent_ = 75;
  std::optional<int> threads_;
  std::optional<std::string> evaluate_;
  std::uint64_t views_ = 200;
  std::uint64_t seed_ = 1;
  double heading_range_deg_ = 15;
};

}  // namespace nadir
