// An Api around a board, with a clock that the test moves.
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "api/api.hpp"
#include "api/painted_tiles.hpp"
#include "api/scripted_flight.hpp"

namespace nadir::test {

class ApiFixture : public ::testing::Test {
 protected:
  ApiFixture() { publish(ServiceState::normal); }

  void publish(ServiceState state) { board.publish(flight.at(now_s, state)); }
  ApiOptions options() {
    ApiOptions chosen;
    chosen.now_s = [this] { return now_s; };
    return chosen;
  }
  static ApiRequest get(std::string target) {
    ApiRequest request;
    request.method = "GET";
    request.target = std::move(target);
    request.host = "localhost:8750";
    return request;
  }
  static ApiRequest post(std::string target, std::string body) {
    ApiRequest request = get(std::move(target));
    request.method = "POST";
    request.content_type = "application/json";
    request.body = std::move(body);
    return request;
  }
  static nlohmann::json json(const ApiResponse& response) { return nlohmann::json::parse(response.body); }

  double now_s = 100;
  ScriptedFlight flight;
  FlightBoard board;
  LatestSlot<Hint> hints;
  Api api{board, hints, options()};
};

inline void expect_problem(const ApiResponse& response, int status, const std::string& type) {
  EXPECT_EQ(response.status, status) << response.body;
  EXPECT_EQ(response.content_type, "application/problem+json");
  const nlohmann::json problem = nlohmann::json::parse(response.body);
  EXPECT_EQ(problem["type"], "urn:nadir:problem:" + type);
  EXPECT_EQ(problem["status"], status);
  EXPECT_FALSE(problem["detail"].get<std::string>().empty());
}

}  // namespace nadir::test
