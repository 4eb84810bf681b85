// The figures of the service's rules, each in one place. docs/onboard.md explains them; seconds are monotonic.
#pragma once

namespace nadir {

// Blindness: no picture that odometry or a match can use.
inline constexpr double kBlackout_s = 0.4;       // without a new picture: the camera is silent
inline constexpr double kMissedFrames = 1.2;     // the same for slow cameras, in frame intervals: one frame is missing
inline constexpr double kLatestInIntervals = 2;  // however unevenly they come, in their usual intervals
inline constexpr double kEstimateOverdue_s = 1.0;    // pictures come, but nothing is said about them
inline constexpr double kBlindNoFix_s = 30;          // blind for longer: no fix
inline constexpr double kBlindGrowth_m_per_s = 5.0;  // of σ while blind, between estimates: the filter's own growth
                                                     // stays below it for the first 33 s (1.5 m/s per root second)

// How sure a position must be, one axis.
inline constexpr double kNoFixSigma_m = 500;
inline constexpr double kReturnSigma_m = 400;    // to be told again: no coming and going at the limit
inline constexpr double kNoFixAccuracy_m = 999;  // what is told with "no fix"

// Without any position, neither ours nor a GPS that is trusted.
inline constexpr double kFailsafe_s = 3;

// Hysteresis: so long must everything be good without a break before the state is a better one again.
inline constexpr double kReturnFromDegraded_s = 1;
inline constexpr double kReturnFromNoFix_s = 1;
inline constexpr double kReturnFromFailsafe_s = 2;

// No message from the autopilot: the link is lost.
inline constexpr double kLinkLost_s = 5;

// How often what happens.
inline constexpr double kFixPeriod_s = 0.1;           // GPS_INPUT, predicted between pictures
inline constexpr double kGroundStatusPeriod_s = 1.0;  // to the ground station
inline constexpr double kSavePeriod_s = 1.0;          // the state directory

}  // namespace nadir
