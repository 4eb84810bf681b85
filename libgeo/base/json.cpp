#include "base/json.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <set>
#include <vector>

#include "base/error.hpp"

namespace nadir {
namespace {

// Walks the document without building it and notes the first thing that we do not accept.
class Guard final : public nlohmann::json_sax<nlohmann::json> {
 public:
  explicit Guard(const JsonLimits& limits) : limits_(limits) {}

  const std::string& complaint() const { return complaint_; }

  bool null() override { return true; }
  bool boolean(bool) override { return true; }
  bool number_integer(number_integer_t) override { return true; }
  bool number_unsigned(number_unsigned_t) override { return true; }
  bool number_float(number_float_t, const string_t& text) override {
    return limits_.allow_floats || complain("the number " + text + ", where only whole numbers are allowed");
  }
  bool string(string_t&) override { return true; }
  bool binary(binary_t&) override { return true; }
  bool start_object(std::size_t) override {
    keys_.emplace_back();
    return deeper();
  }
  bool key(string_t& name) override {
    return keys_.back().insert(name).second || complain("the key \"" + name + "\" twice in one object");
  }
  bool end_object() override {
    keys_.pop_back();
    --depth_;
    return true;
  }
  bool start_array(std::size_t) override { return deeper(); }
  bool end_array() override {
    --depth_;
    return true;
  }
  bool parse_error(std::size_t position, const std::string&, const nlohmann::detail::exception& error) override {
    return complain(fmt::format("at byte {}: {}", position, error.what()));
  }

 private:
  bool deeper() { return ++depth_ <= limits_.max_depth || complain("too deeply nested"); }
  bool complain(std::string text) {
    complaint_ = std::move(text);
    return false;
  }

  JsonLimits limits_;
  std::string complaint_;
  std::vector<std::set<std::string>> keys_;
  int depth_ = 0;
};

}  // namespace

nlohmann::json parse_json(std::string_view text, std::string_view name, const JsonLimits& limits) {
  Guard guard(limits);
  if (!nlohmann::json::sax_parse(text, &guard)) {
    throw Error({.what = "cannot accept this JSON", .where = std::string(name), .found = guard.complaint()});
  }
  return nlohmann::json::parse(text);
}

}  // namespace nadir
