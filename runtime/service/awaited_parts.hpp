// What the service is waiting for, as lines for the system's log: one when the waiting begins, one
// each minute while it lasts, and one when the part is there.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace nadir {

class AwaitedParts {
 public:
  struct Part {
    std::string name;  // "camera"
    std::function<bool(double now_s)> here;
    std::function<std::string()> wait;  // what is waited for, and why it may not come
  };

  explicit AwaitedParts(std::vector<Part> parts);

  // The lines that are due. now_s: monotonic.
  std::vector<std::string> update(double now_s);

 private:
  struct State {
    Part part;
    bool known = false;             // whether it is here
    std::optional<double> since_s;  // missing since
    double next_s = 0;              // of its next line
  };
  std::vector<State> states_;
};

}  // namespace nadir
