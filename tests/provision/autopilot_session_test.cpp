// What provisioning says about a port that it cannot use.
#include "provision/autopilot_session.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "provision/autopilot_provisioning.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using testing::HasSubstr;

constexpr double kTimeout_s = 0.2;

ErrorText refusal(const std::string& url) {
  AutopilotSession session(url, kTimeout_s);
  try {
    session.open();
    identify(session);
  } catch (const Error& error) {
    return error.text();
  }
  ADD_FAILURE() << url;
  return {};
}

TEST(AutopilotSession, APortThatIsNotThereIsNamedAsSuch) {
  const ErrorText text = refusal("serial:/dev/nadir-no-such-port:57600");
  EXPECT_EQ(text.what, "cannot connect to the autopilot");
  EXPECT_EQ(text.found, "serial:/dev/nadir-no-such-port:57600: No such file or directory");
  EXPECT_THAT(text.fix, HasSubstr("no other program uses it"));
}

TEST(AutopilotSession, AFileThatIsNoPortIsNamedAsSuch) {
  const test::TemporaryFolder folder;
  folder.write("file", "");
  EXPECT_THAT(refusal("serial:" + (folder / "file").string() + ":57600").found,
              HasSubstr("Inappropriate ioctl for device"));
}

TEST(AutopilotSession, AnAutopilotThatIsSilentOnAnOpenPortIsNot) {
  const ErrorText text = refusal("udpin:127.0.0.1:0");
  EXPECT_EQ(text.what, "no autopilot answers");
  EXPECT_THAT(text.fix, HasSubstr("check power, cable"));
}

}  // namespace
}  // namespace nadir
