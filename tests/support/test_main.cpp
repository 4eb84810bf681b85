#include <gmock/gmock.h>

// GoogleTest's own, and exit code 77 where nothing failed but a case was skipped: ctest then shows the suite as
// skipped.
int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  const int code = RUN_ALL_TESTS();
  const bool skipped = testing::UnitTest::GetInstance()->skipped_test_count() > 0;
  return code == 0 && skipped ? 77 : code;
}
