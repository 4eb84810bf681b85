// A desk over a folder of its own, and requests to it.
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "desk/desk_api.hpp"
#include "flights/stored_flight.hpp"
#include "package/package_maker.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::test {

// The text of camera.yaml for the camera of flight_pictures().
std::string camera_yaml();

// POST …/pictures of a batch, with its telemetry as telemetry.csv.
struct BatchBody {
  std::string content_type;
  std::string body;
};
std::string telemetry_csv(const std::vector<EncodedPicture>& pictures);
BatchBody batch_of(const std::vector<EncodedPicture>& pictures, const std::string& telemetry,
                   const std::string& telemetry_type = "text/csv");

class DeskFixture : public ::testing::Test {
 protected:
  DeskFixture();
  ~DeskFixture() override { close(); }

  void open();  // a desk; what an earlier one left is there
  void close();

  ApiRequest get(std::string target) const;
  ApiRequest request(std::string method, std::string target, std::string body = {}) const;  // body: JSON
  ApiRequest post(std::string target, std::string body, std::string type = "application/json") const;
  ApiResponse call(const ApiRequest& request) const { return api->handle(request); }
  nlohmann::json json(const ApiResponse& response) const { return nlohmann::json::parse(response.body); }
  nlohmann::json read(const std::string& target) const;

  std::string create(const nlohmann::json& change = nlohmann::json::object());  // its path: "/v1/flights/ID"
  ApiResponse send(const std::string& flight, const std::vector<EncodedPicture>& pictures) const;
  // Waits until the flight has nothing to do; its document.
  nlohmann::json settled(const std::string& flight) const;

  TemporaryFolder folder;
  DeskOptions options;
  DeskApiOptions api_options;
  std::unique_ptr<DeskService> desk;
  std::unique_ptr<FairQueue> queue;
  std::unique_ptr<DeskApi> api;
};

}  // namespace nadir::test
