// poses.json: the same bits come back, and nothing that is damaged or belongs to something else is taken for poses.
#include "replay/poses_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using ::testing::HasSubstr;

std::vector<Telemetry> frames_of_flight() {
  std::vector<Telemetry> frames(4);
  for (std::size_t i = 0; i < frames.size(); ++i) frames[i].frame = "pic " + std::to_string(i) + ".jpg";
  return frames;
}

PosesSubject subject() {
  return {.flight = "0123456789ab",
          .frames = 4,
          .base_package = sha256(as_bytes("package")),
          .camera = sha256(as_bytes("camera")),
          .origin = {8.1 + 0.2, -47.4}};
}

// Values without a short decimal form.
FramePose odd_pose() {
  FramePose said;
  said.pose.position = {1.0 / 3.0, -0.0};
  said.pose.agl_m = 100 * std::exp(0.1);
  said.pose.attitude = {-1e-17, std::nextafter(0.1, 1), -2.0 / 7.0};
  said.covariance_m2 << 0.1 + 0.2, -1e-9, -1e-9, std::sqrt(2.0);
  said.sigma_m = std::sqrt(0.5 * said.covariance_m2.trace());
  said.source = SourceLabel::satellite_anchored;
  said.confirmed = said.refined = true;
  said.motion = {{12.0 / 7.0, -1e-300}, {0.1 + 0.2, -1.0 / 3.0, 5e-17}};
  return said;
}

std::vector<std::uint64_t> bits_of(const FramePose& said) {
  std::vector<std::uint64_t> bits;
  for (const double value :
       {said.pose.position.east_m, said.pose.position.north_m, said.pose.agl_m, said.pose.attitude.heading_rad,
        said.pose.attitude.pitch_rad, said.pose.attitude.roll_rad, said.covariance_m2(0, 0), said.covariance_m2(0, 1),
        said.covariance_m2(1, 0), said.covariance_m2(1, 1), said.sigma_m, said.anchor_age_s,
        said.motion.velocity_mps.x(), said.motion.velocity_mps.y(), said.motion.rate_rad_s.x(),
        said.motion.rate_rad_s.y(), said.motion.rate_rad_s.z()}) {
    bits.push_back(std::bit_cast<std::uint64_t>(value));
  }
  return bits;
}

class PosesFile : public ::testing::Test {
 protected:
  PosesFile() {
    poses_[1] = odd_pose();
    poses_[3] = odd_pose();
    poses_[3]->confirmed = false;
  }
  std::string text() const { return poses_json(poses_document(subject(), frames_of_flight(), poses_)); }
  std::vector<std::optional<FramePose>> read(const std::string& bytes, const PosesSubject& wanted = subject()) const {
    folder_.write("poses.json", bytes);
    return read_poses(folder_ / "poses.json", wanted, frames_of_flight()).poses;
  }
  std::string complaint(const std::string& bytes, const PosesSubject& wanted = subject()) const {
    try {
      read(bytes, wanted);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }
  // Of the document with one member of its first pose changed; null takes the member out.
  std::string changed(const std::string& member, const nlohmann::json& value) const {
    nlohmann::json document = nlohmann::json::parse(text());
    auto& pose = document["poses"][0];
    if (value.is_null()) {
      pose.erase(member);
    } else {
      pose[member] = value;
    }
    return complaint(document.dump());
  }

  test::TemporaryFolder folder_;
  std::vector<std::optional<FramePose>> poses_{4};
};

TEST_F(PosesFile, RoundTripsBitForBit) {
  const auto again = read(text());
  ASSERT_EQ(again.size(), 4U);
  EXPECT_FALSE(again[0] || again[2]);
  for (const std::size_t i : {1U, 3U}) {
    ASSERT_TRUE(again[i]);
    EXPECT_EQ(bits_of(*again[i]), bits_of(*poses_[i]));
    EXPECT_EQ(again[i]->confirmed, poses_[i]->confirmed);
    EXPECT_EQ(again[i]->source, SourceLabel::satellite_anchored);
    EXPECT_TRUE(again[i]->refined);
  }
}

TEST_F(PosesFile, HasTheLensOfAdjustedPoses) {
  EXPECT_FALSE(parse_poses(text(), "poses").lens);
  const AdjustedLens lens{.log_focal = 0.1 / 3, .distortion = {-1e-3, 1.0 / 7, 0, -0.0, 2e-9}};
  const std::string with = poses_json(poses_document(subject(), frames_of_flight(), poses_, lens));
  folder_.write("poses.json", with);
  EXPECT_EQ(read_poses(folder_ / "poses.json", subject(), frames_of_flight()).lens, lens);
  const auto changed_lens = [&](const char* member, const nlohmann::json& value) {
    nlohmann::json document = nlohmann::json::parse(with);
    document["lens"][member] = value;
    return complaint(document.dump());
  };
  EXPECT_THAT(changed_lens("log_focal", 1.5), HasSubstr("/lens/log_focal"));
  EXPECT_THAT(changed_lens("log_focal", nullptr), HasSubstr("/lens/log_focal"));
  EXPECT_THAT(changed_lens("distortion", {0, 0, 0, 0}), HasSubstr("/lens/distortion"));
  EXPECT_THAT(changed_lens("distortion", {0, 0, 0, 0, 1e9}), HasSubstr("/lens/distortion/4"));
  EXPECT_THAT(changed_lens("name", "wide"), HasSubstr("only members that this version knows"));
  nlohmann::json without = nlohmann::json::parse(with);
  without.erase("lens");
  EXPECT_THAT(complaint(without.dump()), HasSubstr("lens"));
}

TEST_F(PosesFile, AFlightWithoutAnchorsHasNoPoses) {
  poses_.assign(4, std::nullopt);
  const auto again = read(text());
  ASSERT_EQ(again.size(), 4U);
  for (const auto& pose : again) EXPECT_FALSE(pose);
}

TEST_F(PosesFile, BelongsToOneFlightMapAndCamera) {
  PosesSubject other = subject();
  other.flight = "ba9876543210";
  EXPECT_THAT(complaint(text(), other), HasSubstr("another flight"));
  other = subject();
  other.base_package = sha256(as_bytes("another"));
  EXPECT_THAT(complaint(text(), other), HasSubstr("another map"));
  other = subject();
  other.camera = sha256(as_bytes("another"));
  EXPECT_THAT(complaint(text(), other), HasSubstr("another camera"));
  other = subject();
  other.origin.lat_deg = std::nextafter(other.origin.lat_deg, 0);
  EXPECT_THAT(complaint(text(), other), HasSubstr("another plane"));
  EXPECT_THAT(changed("frame", "pic_2.jpg"), HasSubstr("name of a frame"));
}

TEST_F(PosesFile, RejectsInvalidPoses) {
  EXPECT_EQ(changed("confirmed", true), "") << "unchanged";
  for (const char* member : {"east_m", "north_m", "agl_m", "heading_rad", "pitch_rad", "roll_rad", "cov_ee_m2",
                             "cov_en_m2", "cov_nn_m2", "index", "frame", "confirmed", "velocity_mps", "rate_rad_s"}) {
    EXPECT_THAT(changed(member, nullptr), HasSubstr(std::string("a member \"") + member)) << member;
    EXPECT_THAT(changed(member, nlohmann::json::array()), HasSubstr(std::string("/poses/0/") + member));
    EXPECT_THAT(changed(member, 1e300), HasSubstr(std::string("/poses/0/") + member));
  }
  EXPECT_THAT(changed("agl_m", 0), HasSubstr("agl_m"));
  EXPECT_THAT(changed("cov_ee_m2", -0.1), HasSubstr("cov_ee_m2"));
  EXPECT_THAT(changed("cov_en_m2", 5), HasSubstr("what the variances allow"));
  EXPECT_THAT(changed("index", 4), HasSubstr("less than the number of frames"));
  EXPECT_THAT(changed("index", 3), HasSubstr("/poses/1/index")) << "twice";
  EXPECT_THAT(changed("index", -1), HasSubstr("an integer"));
  EXPECT_THAT(changed("index", 1.5), HasSubstr("an integer"));
  EXPECT_THAT(changed("frame", "../1.jpg"), HasSubstr("frame"));
  EXPECT_THAT(changed("note", 1), HasSubstr("only members that this version knows"));
}

TEST_F(PosesFile, RejectsTruncatedOrInvalidDocuments) {
  const std::string whole = text();
  for (std::size_t length = 0; length + 2 < whole.size(); length += 23) {
    EXPECT_NE(complaint(whole.substr(0, length)), "") << length;
  }
  for (const char* bytes : {"", "[]", "null", "\xff\xfe", "{}", R"({"schema":"nadir.poses/2"})"}) {
    EXPECT_THAT(complaint(bytes), HasSubstr("poses.json")) << bytes;
  }
  std::string other = whole;
  other.replace(other.find("nadir.poses/3"), 13, "nadir.poses/2");
  EXPECT_THAT(complaint(other), HasSubstr("nadir.poses/2"));
  EXPECT_THROW(read_poses(folder_ / "none.json", subject(), frames_of_flight()), Error);
}

}  // namespace
}  // namespace nadir
