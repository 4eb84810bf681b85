// `nadir ortho`: what a flight saw, as signed candidate tiles and as a mosaic for people.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "replay/flight_request.hpp"

namespace nadir {

class OrthoCommand final : public Command {
 public:
  std::string_view group() const override { return {}; }
  std::string_view name() const override { return "ortho"; }
  std::string_view summary() const override { return "make signed candidate tiles of what a flight saw"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::vector<std::optional<FramePose>> poses_of(Context& context, const ReadyFlight& ready) const;

  FlightRequest request_{"nadir ortho"};
  std::filesystem::path key_, out_;
  std::optional<std::filesystem::path> estimates_;
  std::optional<std::string> flight_;
  std::optional<std::string> captured_at_;
  std::optional<std::filesystem::path> mosaic_;
  std::string format_ = "jpeg";
  int quality_ = 82;
  std::optional<int> zoom_;
  bool single_frame_ = false;
  int frame_ms_ = 0;
  std::int64_t budget_mb_ = 4096;
};

}  // namespace nadir
