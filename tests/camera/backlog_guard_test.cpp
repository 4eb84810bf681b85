// Pauses, and the backlog that cameras deliver after them.
#include "camera/backlog_guard.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <vector>

namespace nadir {
namespace {

using Verdict = BacklogGuard::Verdict;

// The verdict on each frame: f(resh), s(tale), w(ait).
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
    return verdict == Verdict::fresh ? 'f' : verdict == Verdict::stale ? 's' : 'w';
  }
  double interval_s_;
};

TEST(BacklogGuard, FramesOfASteadyCameraAreFresh) {
  for (const double interval_s : {0.02, 1.0 / 3, 1.0}) {
    Camera camera(interval_s);
    EXPECT_EQ(camera.pictures(20), std::string(20, 'f')) << interval_s;
    EXPECT_FALSE(camera.guard.settled_s());
  }
  Camera uneven(0.3);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(uneven.after(i % 2 == 0 ? 0.1 : 0.5), Verdict::fresh) << i;
}

TEST(BacklogGuard, HoldsAfterAPauseUntilTheNextFrameWouldBeDue) {
  Camera camera(0.4);
  EXPECT_EQ(camera.after(6), Verdict::hold);
  ASSERT_TRUE(camera.guard.settled_s());
  EXPECT_NEAR(*camera.guard.settled_s(), camera.now_s + 0.3, 1e-9);
  EXPECT_EQ(camera.pictures(5), "fffff") << "the camera was silent and had no backlog";
  EXPECT_FALSE(camera.guard.settled_s());
}

// Six seconds of frames at once: all are old, except the first one at the regular interval.
TEST(BacklogGuard, DetectsABacklogByItsShortIntervals) {
  for (const double quick_s : {0.0, 0.01, 0.2}) {
    Camera camera(0.4);
    EXPECT_EQ(camera.after(6), Verdict::hold);
    EXPECT_EQ(camera.pictures(10, quick_s), std::string(10, 's')) << quick_s;
    EXPECT_FALSE(camera.guard.settled_s()) << "nothing is held";
    EXPECT_EQ(camera.pictures(3), "fff");
  }
}

// A backlog cannot hold more frames than were taken in the pause: after that, a camera that is faster than before is
// accepted as such.
TEST(BacklogGuard, ABacklogIsNotLongerThanThePause) {
  Camera camera(0.5);
  EXPECT_EQ(camera.after(2.5), Verdict::hold);  // four intervals are missing
  EXPECT_EQ(camera.pictures(6, 0), "sssfff");
  Camera faster(0.5);
  EXPECT_EQ(faster.after(2.5), Verdict::hold);
  EXPECT_EQ(faster.pictures(12, 0.11), "sssssfffffff");
}

TEST(BacklogGuard, APauseInTheMiddleOfABacklogIsAnother) {
  Camera camera(0.4);
  camera.after(6);
  EXPECT_EQ(camera.pictures(3, 0), "sss");
  EXPECT_EQ(camera.after(4), Verdict::hold);
  EXPECT_EQ(camera.pictures(3, 0), "sss");
  EXPECT_EQ(camera.after(0.4), Verdict::fresh);
}

TEST(BacklogGuard, AdaptsToASlowerCamera) {
  Camera camera(0.3);
  std::string said;
  for (int i = 0; i < 20; ++i) said += camera.after(1.0) == Verdict::hold ? 'w' : 'f';
  EXPECT_EQ(said.substr(8), std::string(12, 'f')) << said;
}

TEST(BacklogGuard, ShortGapsAndUnmeasuredCamerasAreNotPauses) {
  Camera fast(0.03);
  EXPECT_EQ(fast.after(0.45), Verdict::fresh);
  Camera slow(1);
  EXPECT_EQ(slow.after(2.4), Verdict::fresh) << "one frame is missing";
  BacklogGuard unknown;
  for (const double at_s : {1.0, 2.0, 60.0, 60.0, 60.1}) EXPECT_EQ(unknown.classify(at_s), Verdict::fresh) << at_s;
}

// With a camera that always delivers in bursts, short intervals are no sign of a backlog.
TEST(BacklogGuard, AlwaysBurstyFramesAreFresh) {
  BacklogGuard guard;
  for (int bunch = 0; bunch < 30; ++bunch) {
    for (int i = 0; i < 3; ++i) EXPECT_NE(guard.classify(bunch), Verdict::stale) << bunch;
  }
}

TEST(BacklogGuard, InvalidOrBackwardTimesAreFresh) {
  Camera camera(0.4);
  EXPECT_EQ(camera.guard.classify(std::numeric_limits<double>::quiet_NaN()), Verdict::fresh);
  EXPECT_EQ(camera.after(6), Verdict::hold);
  EXPECT_EQ(camera.guard.classify(5), Verdict::fresh);
  EXPECT_FALSE(camera.guard.settled_s());
}

}  // namespace
}  // namespace nadir
