#include "trust/time_permit.hpp"

#include <gtest/gtest.h>

#include "trust/aircraft_state.hpp"

namespace nadir {
namespace {

constexpr UtcTime kAt{1'750'000'000};
constexpr UtcTime kWrong{1'800'000'000};

class TimePermits : public ::testing::Test {
 protected:
  TimePermits() {
    root_.version = 1;
    root_.expires = UtcTime{kAt.unix_s + 1'000'000};
    root_.add_key(signer_.public_key());
    root_.package_signer = Role{{signer_.public_key().id()}, 1};
    root_.root = root_.package_signer;
  }
  SignedTimePermit permit(std::optional<std::string> airframe = std::nullopt) const {
    return sign_time_permit({kWrong, kAt, std::move(airframe), UtcTime{kAt.unix_s + 1000}}, {&signer_});
  }
  bool allows(const SignedTimePermit& permit, UtcTime remembered = kWrong, UtcTime at = kAt) const {
    return !check_time_permit(permit, root_, {remembered, "mini-07", at}).has_errors();
  }

  PrivateKey signer_ = PrivateKey::generate();
  TrustRoot root_;
};

TEST_F(TimePermits, AllowExactlyWhatTheyName) {
  EXPECT_TRUE(allows(permit()));
  EXPECT_TRUE(allows(permit("mini-07")));
  EXPECT_FALSE(allows(permit("mini-08")));
  EXPECT_FALSE(allows(permit(), UtcTime{kWrong.unix_s + 1})) << "another remembered time: it was used, or is not meant";
  EXPECT_FALSE(allows(permit(), kWrong, UtcTime{kAt.unix_s + 1000})) << "expired";
}

TEST_F(TimePermits, AreInvalidWhenEditedOrForeign) {
  std::string text = permit().document.json();
  const std::size_t year = text.find("2027");
  ASSERT_NE(year, std::string::npos);
  text[year + 3] = '8';
  EXPECT_FALSE(allows(parse_time_permit(text, "permit"), UtcTime{kWrong.unix_s + 366 * 86'400}));
  const PrivateKey untrusted = PrivateKey::generate();
  EXPECT_FALSE(allows(sign_time_permit({kWrong, kAt, std::nullopt, UtcTime{kAt.unix_s + 1000}}, {&untrusted})));
}

TEST_F(TimePermits, OfAnotherFormAreErrors) {
  const std::string text = permit().document.json();
  for (std::size_t size = 0; size < text.size(); size += 7) {
    EXPECT_THROW(parse_time_permit(text.substr(0, size), "permit"), Error) << size;
  }
  EXPECT_THROW(sign_time_permit({kAt, kWrong, std::nullopt, kWrong}, {&signer_}), Error) << "forwards";
}

// However far ahead a clock runs, and however often.
TEST(RememberedTime, IsAtMostAMonthBeyondTheDayThePackageWasMade) {
  const UtcTime created{1'700'000'000};
  EXPECT_EQ(remembered_time(UtcTime{created.unix_s + 100}, created), UtcTime{created.unix_s + 100});
  AircraftState state;
  for (int year = 1; year < 10; ++year) {
    state.accept("valley", 1, 1, remembered_time(UtcTime{created.unix_s + year * 31'536'000}, created));
  }
  EXPECT_EQ(state.last_trusted_time, UtcTime{created.unix_s + kMaxTrustedLead_s});
}

}  // namespace
}  // namespace nadir
