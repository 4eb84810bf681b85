// Pauses, and the backlog that cameras deliver after them.
#include "camera/backlog_guard.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <vector>

namespace nadir {
namespace {

using Verdict = BacklogGuard::Verdict;

// The verdict on each frame: f(resh), s(tale), u(nproven).
class Camera {
 public:
  explicit Camera(double interval_s) : interval_s_(interval_s) { pictures(8); }

  Verdict after(double interval_s) { return guard.classify(now_s += interval_s); }
  std::string pictures(int count) { return pictures(count, interval_s_); }
  std::string pictures(int count, double interval_s) {
    std::string said;
    for (int i = 0; i < count; ++i) said += letter(after(interval_s));
    return said;
  }

  BacklogGuard guard;
  double now_s = 100;

 private:
  static char letter(Verdict verdict) {
    return verdict == Verdict::fresh ? 'f' : verdict == Verdict::stale ? 's' : 'u';
  }
  double interval_s_;
};

TEST(BacklogGuard, FramesOfASteadyCameraAreFresh) {
  for (const double interval_s : {0.02, 1.0 / 3, 1.0}) {
    Camera camera(interval_s);
    EXPECT_EQ(camera.pictures(20), std::string(20, 'f')) << interval_s;
  }
  Camera uneven(0.3);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(uneven.after(i % 2 == 0 ? 0.1 : 0.5), Verdict::fresh) << i;
}

// A buffer of one frame suffices for it to be as old as the pause.
TEST(BacklogGuard, TheFirstFrameAfterAPauseIsUnproven) {
  Camera camera(0.4);
  EXPECT_EQ(camera.after(6), Verdict::unproven);
  EXPECT_EQ(camera.pictures(5), "fffff");
  Camera early(0.4);
  EXPECT_EQ(early.after(6), Verdict::unproven);
  EXPECT_EQ(early.after(0.31), Verdict::fresh) << "the camera was silent in between, or late";
}

// Six seconds of frames at once: all are old, except the first one at the regular interval.
TEST(BacklogGuard, DetectsABacklogByItsShortIntervals) {
  for (const double quick_s : {0.0, 0.01, 0.2}) {
    Camera camera(0.4);
    EXPECT_EQ(camera.after(6), Verdict::unproven);
    EXPECT_EQ(camera.pictures(10, quick_s), std::string(10, 's')) << quick_s;
    EXPECT_EQ(camera.pictures(3), "fff");
  }
}

// A backlog cannot hold more frames than were taken in the pause: after that, a camera that is faster than before is
// accepted as such.
TEST(BacklogGuard, ABacklogIsNotLongerThanThePause) {
  Camera camera(0.5);
  EXPECT_EQ(camera.after(2.5), Verdict::unproven);  // four intervals are missing
  EXPECT_EQ(camera.pictures(6, 0), "sssfff");
  Camera faster(0.5);
  EXPECT_EQ(faster.after(2.5), Verdict::unproven);
  EXPECT_EQ(faster.pictures(12, 0.11), "sssssfffffff");
}

TEST(BacklogGuard, APauseInTheMiddleOfABacklogIsAnother) {
  Camera camera(0.4);
  camera.after(6);
  EXPECT_EQ(camera.pictures(3, 0), "sss");
  EXPECT_EQ(camera.after(4), Verdict::unproven);
  EXPECT_EQ(camera.pictures(3, 0), "sss");
  EXPECT_EQ(camera.after(0.4), Verdict::fresh);
}

TEST(BacklogGuard, AdaptsToASlowerCamera) {
  Camera camera(0.3);
  std::string said;
  for (int i = 0; i < 20; ++i) said += camera.after(1.0) == Verdict::unproven ? 'u' : 'f';
  EXPECT_EQ(said, 'u' + std::string(19, 'f'));
}

TEST(BacklogGuard, ShortGapsAndUnmeasuredCamerasAreNotPauses) {
  Camera fast(0.03);
  EXPECT_EQ(fast.after(0.45), Verdict::fresh);
  Camera slow(1);
  EXPECT_EQ(slow.after(2.4), Verdict::fresh) << "one frame is missing";
  BacklogGuard unknown;
  for (const double at_s : {1.0, 2.0, 60.0, 60.0, 60.1}) EXPECT_EQ(unknown.classify(at_s), Verdict::fresh) << at_s;
}

// Of a camera that always delivers in bursts, only the first one of each is as old as the burst is long.
TEST(BacklogGuard, ACameraThatAlwaysDeliversInBurstsLosesTheFirstFrames) {
  BacklogGuard guard;
  for (int burst = 0; burst < 30; ++burst) {
    for (int i = 0; i < 3; ++i) {
      const Verdict verdict = guard.classify(burst);
      if (burst <= 2) continue;
      EXPECT_EQ(verdict, i == 0 ? Verdict::unproven : Verdict::fresh) << burst;
    }
  }
}

TEST(BacklogGuard, InvalidOrBackwardTimesAreFresh) {
  Camera camera(0.4);
  EXPECT_EQ(camera.guard.classify(std::numeric_limits<double>::quiet_NaN()), Verdict::fresh);
  EXPECT_EQ(camera.after(6), Verdict::unproven);
  EXPECT_EQ(camera.guard.classify(5), Verdict::fresh);
}

}  // namespace
}  // namespace nadir
