#include "upload/http_date.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <span>

namespace nadir {
namespace {

// In strftime()'s words. Its opposite strptime() would read them by the locale, and more than they say.
constexpr std::array<std::string_view, 3> kForms{"%a, %d %b %Y %T GMT", "%A, %d-%b-%y %T GMT", "%a %b %e %T %Y"};

constexpr std::array<std::string_view, 7> kDays{"Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"};
constexpr std::array<std::string_view, 7> kLongDays{"Monday", "Tuesday",  "Wednesday", "Thursday",
                                                    "Friday", "Saturday", "Sunday"};
constexpr std::array<std::string_view, 12> kMonths{"Jan", "Feb", "Mar", "Apr", "May", "Jun",
                                                   "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"};

struct Parts {
  int year = 0, month = 0, day = 0, hour = 0, minute = 0, second = 0;
};

// Takes one piece after the other off the text; after the first that does not fit nothing fits any more.
class DateReader {
 public:
  explicit DateReader(std::string_view text) : rest_(text) {}

  std::optional<Parts> read(std::string_view form) {
    for (std::size_t at = 0; at < form.size(); ++at) {
      if (form[at] == '%') {
        field(form[++at]);
      } else {
        skip(form.substr(at, 1));
      }
    }
    return good_ && rest_.empty() ? std::optional(parts_) : std::nullopt;
  }

 private:
  void field(char name) {
    switch (name) {
      case 'a': one_of(kDays); return;
      case 'A': one_of(kLongDays); return;
      case 'b': parts_.month = one_of(kMonths) + 1; return;
      case 'd': parts_.day = digits(2); return;
      case 'e': parts_.day = rest_.starts_with(' ') ? (skip(" "), digits(1)) : digits(2); return;
      case 'Y': parts_.year = digits(4); return;
      case 'y':
        parts_.year = digits(2);
        parts_.year += parts_.year < 70 ? 2000 : 1900;
        return;
      default:  // 'T'
        parts_.hour = digits(2);
        skip(":");
        parts_.minute = digits(2);
        skip(":");
        parts_.second = digits(2);
    }
  }
  void skip(std::string_view piece) {
    good_ = good_ && rest_.starts_with(piece);
    if (good_) rest_.remove_prefix(piece.size());
  }
  int one_of(std::span<const std::string_view> pieces) {
    const auto fits = std::find_if(pieces.begin(), pieces.end(), [&](auto piece) { return rest_.starts_with(piece); });
    good_ = good_ && fits != pieces.end();
    if (good_) rest_.remove_prefix(fits->size());
    return static_cast<int>(fits - pieces.begin());
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

  std::string_view rest_;
  Parts parts_;
  bool good_ = true;
};

}  // namespace

std::optional<UtcTime> parse_http_date(std::string_view text) {
  for (const std::string_view form : kForms) {
    if (const auto parts = DateReader(text).read(form)) {
      return parse_utc(fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z", parts->year, parts->month, parts->day,
                                   parts->hour, parts->minute, parts->second));
    }
  }
  return std::nullopt;
}

}  // namespace nadir
