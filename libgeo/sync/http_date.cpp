#include "sync/http_date.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <span>
#include <string>

namespace nadir {
namespace {

// Takes one piece after the other off the text; after the first that does not fit nothing fits any more.
class DateReader {
 public:
  explicit DateReader(std::string_view text) : rest_(text) {}

  void skip(std::string_view piece) {
    good_ = good_ && rest_.starts_with(piece);
    if (good_) rest_.remove_prefix(piece.size());
  }
  void skip_one_of(std::span<const std::string_view> pieces) {
    const auto fits = std::find_if(pieces.begin(), pieces.end(), [&](auto piece) { return rest_.starts_with(piece); });
    good_ = good_ && fits != pieces.end();
    if (good_) rest_.remove_prefix(fits->size());
  }
  int digits(std::size_t count) {
    int value = 0;
    const std::string_view piece = rest_.substr(0, count);
    good_ = good_ && piece.size() == count &&
            std::all_of(piece.begin(), piece.end(), [](char c) { return c >= '0' && c <= '9'; });
    if (!good_) return 0;
    std::from_chars(piece.data(), piece.data() + piece.size(), value);
    rest_.remove_prefix(count);
    return value;
  }
  int month() {
    constexpr std::array<std::string_view, 12> kMonths{"Jan", "Feb", "Mar", "Apr", "May", "Jun",
                                                       "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"};
    const auto found = std::find(kMonths.begin(), kMonths.end(), rest_.substr(0, 3));
    good_ = good_ && found != kMonths.end();
    if (good_) rest_.remove_prefix(3);
    return static_cast<int>(found - kMonths.begin()) + 1;
  }
  bool next_is(char c) const { return rest_.starts_with(c); }
  bool done() const { return good_ && rest_.empty(); }

 private:
  std::string_view rest_;
  bool good_ = true;
};

struct Parts {
  int year = 0, month = 0, day = 0;
  std::string clock;  // "08:49:37"
};

std::string clock_of(DateReader& in) {
  const int hour = in.digits(2);
  in.skip(":");
  const int minute = in.digits(2);
  in.skip(":");
  return fmt::format("{:02}:{:02}:{:02}", hour, minute, in.digits(2));
}

constexpr std::array<std::string_view, 7> kDays{"Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"};
constexpr std::array<std::string_view, 7> kLongDays{"Monday", "Tuesday",  "Wednesday", "Thursday",
                                                    "Friday", "Saturday", "Sunday"};

std::optional<Parts> fixed_form(std::string_view text) {
  DateReader in(text);
  Parts parts;
  in.skip_one_of(kDays);
  in.skip(", ");
  parts.day = in.digits(2);
  in.skip(" ");
  parts.month = in.month();
  in.skip(" ");
  parts.year = in.digits(4);
  in.skip(" ");
  parts.clock = clock_of(in);
  in.skip(" GMT");
  return in.done() ? std::optional(parts) : std::nullopt;
}

std::optional<Parts> long_day_form(std::string_view text) {
  DateReader in(text);
  Parts parts;
  in.skip_one_of(kLongDays);
  in.skip(", ");
  parts.day = in.digits(2);
  in.skip("-");
  parts.month = in.month();
  in.skip("-");
  parts.year = in.digits(2);
  parts.year += parts.year < 70 ? 2000 : 1900;
  in.skip(" ");
  parts.clock = clock_of(in);
  in.skip(" GMT");
  return in.done() ? std::optional(parts) : std::nullopt;
}

std::optional<Parts> asctime_form(std::string_view text) {
  DateReader in(text);
  Parts parts;
  in.skip_one_of(kDays);
  in.skip(" ");
  parts.month = in.month();
  in.skip(" ");
  if (in.next_is(' ')) {
    in.skip(" ");
    parts.day = in.digits(1);
  } else {
    parts.day = in.digits(2);
  }
  in.skip(" ");
  parts.clock = clock_of(in);
  in.skip(" ");
  parts.year = in.digits(4);
  return in.done() ? std::optional(parts) : std::nullopt;
}

}  // namespace

std::optional<UtcTime> parse_http_date(std::string_view text) {
  for (const auto form : {fixed_form, long_day_form, asctime_form}) {
    if (const auto parts = form(text)) {
      return parse_utc(fmt::format("{:04}-{:02}-{:02}T{}Z", parts->year, parts->month, parts->day, parts->clock));
    }
  }
  return std::nullopt;
}

}  // namespace nadir
