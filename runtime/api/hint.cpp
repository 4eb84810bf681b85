#include "api/requests.hpp"

#include <nlohmann/json.hpp>


namespace nadir {

std::variant<Hint, Problem> parse_hint(const ApiRequest& request) {
  nlohmann::json body;
  if (auto problem = read_body(request, body)) return *problem;
  std::vector<FieldError> errors;
  BodyFields fields(body, "", errors);
  Hint hint;
  hint.place.lat_deg = fields.number("lat", {.low = -90, .high = 90});
  hint.place.lon_deg = fields.number("lon", {.low = -180, .high = 180});
  hint.radius_m = fields.number("radius_m", {.low = 0, .high = kMaxHintRadius_m, .above_low = true});
  fields.nothing_else();
  if (auto problem = problem_with(std::move(errors))) return *problem;
  return hint;
}

}  // namespace nadir
