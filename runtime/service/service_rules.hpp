// The numbers of the service's rules in one table: name, unit (s: monotonic seconds), where it comes from. Origins:
//   [design]  docs/onboard.md, which explains the rule
//   [loop]    docs/closed-loop.md: measured with the simulated autopilot or with ArduPlane SITL
//   [aircraft] limits of the aircraft that we fly on
//   [gps]     docs/closed-loop.md, GPS that lies: false alarms against delays, tests/bench/gps.cpp, training seeds
#pragma once

namespace nadir {

// ---- blindness: no frame that odometry or a match can use [design]
inline constexpr double kBlackout_s = 0.4;       // without a new frame: the camera is silent
inline constexpr double kMissedFrames = 1.2;     // the same for slow cameras, in frame intervals: one frame is missing
inline constexpr double kLatestInIntervals = 2;  // however irregular, in median intervals
inline constexpr double kEstimateOverdue_s = 1.0;  // frames arrive, but no estimates
// A frame that takes longer to decode is dropped: it must have been crafted. 100 megapixels take half of this (one core
// of the build machine), the thread that decodes is late after 3 s.
inline constexpr double kMaxFrameDecode_s = 1.0;
inline constexpr double kBlindNoFix_s = 30;      // blind for longer: no fix
inline constexpr double kBlindGrowth_mps = 5.0;  // of σ while blind, between estimates; the filter's own growth is
                                                 // smaller for the first 33 s (1.5 m/s per root second)

// ---- failures of map matching [design]
inline constexpr int kMatchFailures = 5;  // matches in a row that end with an exception: blind, although frames come

// ---- required accuracy, one axis [design]
inline constexpr double kNoFixSigma_m = 500;
inline constexpr double kReturnSigma_m = 400;    // to provide fixes again: hysteresis
inline constexpr double kNoFixAccuracy_m = 999;  // sent with "no fix"

// ---- usable or not: alert limit, time to alert and risk are the mission's (position_usability.hpp) [design]
inline constexpr double kAlertShare = 0.5;  // of the time to alert, beyond the limit, until the operator is told

// ---- no position, neither ours nor that of a trusted GPS [design]
inline constexpr double kFailsafe_s = 3;

// ---- hysteresis: everything must be good for so long without a break before a better state [design]
inline constexpr double kReturnFromDegraded_s = 1;
inline constexpr double kReturnFromNoFix_s = 1;
inline constexpr double kReturnFromFailsafe_s = 2;

// ---- periods and timeouts [design]
inline constexpr double kLinkLost_s = 5;            // no message from the autopilot
inline constexpr double kParametersPending_s = 15;  // to compare the autopilot's parameters, once our position leads
inline constexpr double kSavePeriod_s = 1;          // of the state directory
inline constexpr double kHealthPeriod_s = 5;        // of the measures of the machine, in the recorder
inline constexpr double kAwaitedAfter_s = 5;        // without a frame or the autopilot: it is waited for
inline constexpr double kAwaitedAgain_s = 60;       // between two lines of the log about what is waited for

// ---- lists of events [design]
inline constexpr double kRepeatWindow_s = 300;  // an event of the same wording is one line, with a count

// ---- position hints of people (position_hints.hpp) [design]
inline constexpr double kHintPeriod_s = 2;           // on average, through the API and from ground stations each
inline constexpr int kHintBurst = 3;                 // at once, after a pause
inline constexpr double kMaxHintRadius_m = 100'000;  // a larger one says nothing
inline constexpr double kMaxHintAge_s = 60;          // of the place that a ground station states
inline constexpr double kOriginHintRadius_m = 500;   // of an origin, which states no accuracy
inline constexpr double kAskForHint_s = 15;       // armed, and without any position for so long: the operator is asked
inline constexpr double kAskForHintAgain_s = 60;  // and again

// ---- GPS: denied or spoofed (gps_health.hpp)
inline constexpr double kGpsSilent_s = 1.5;          // no message [design]
inline constexpr double kGpsNoFix_s = 0.5;           // messages without a 3-D fix [design]
inline constexpr double kEkfAlarm_s = 1.0;           // duration of an alarm of the autopilot's filter [design]
inline constexpr double kOurFixInUse_s = 15;         // its alarms may be about our fix for so long after one [loop]
inline constexpr double kMaxGroundSpeed_mps = 100;   // with the wind [aircraft]
inline constexpr double kStepMargin_m = 30;          // beyond what speed and accuracies explain [design]
inline constexpr double kMaxAcceleration_mps2 = 15;  // between two fixes [aircraft]
inline constexpr double kMaxGpsSigma_m = 10;     // a spoofer may claim any accuracy; larger values are capped [design]
inline constexpr double kMinGpsSigma_m = 2.5;    // nor is a receiver's own figure all of its error: reflections [gps]
inline constexpr double kDefaultGpsSigma_m = 3;  // of a receiver that reports none [design]
inline constexpr double kGpsTimeSigma_s = 0.2;   // between measurement and message, one sigma [gps]
inline constexpr double kDisagreementChi2 = 18.4;  // one honest look of 10 000 is beyond, -2 ln 1e-4 [gps]
inline constexpr double kAgreementChi2 = 6.0;      // 95 % of honest looks are within, -2 ln 0.05 [gps]
inline constexpr double kDisagreement_s = 1.0;     // for so long [design]
inline constexpr double kMaxVisionSigma_m = 60;    // less accurate visual positions prove nothing [design]
inline constexpr double kMaxVisionAge_s = 1.0;     // nor do older ones [design]

// ---- GPS: trusted again [design]
inline constexpr double kGpsStable_s = 10;       // undisturbed, and in agreement with vision
inline constexpr double kGpsFirst_s = 5;         // undisturbed, after the search for its first fix
inline constexpr double kGpsStableAlone_s = 60;  // undisturbed, without vision to compare
inline constexpr double kGpsHintRadius_m = 150;  // of the search that a trusted GPS suggests

// ---- restart in flight (saved_flight.hpp)
inline constexpr double kMaxRestartAge_s = 1800;          // older: another flight [design]
inline constexpr double kRebootAllowance_s = 60;          // of unobserved time [design]
inline constexpr double kMinRestartSpeed_mps = 15;        // in flight, whatever was measured last [aircraft]
inline constexpr double kRestartTurn_mps2 = 2.5;          // one sigma of an unobserved turn [aircraft]
inline constexpr double kRestartVelocitySigma_mps = 1;    // [design]
inline constexpr double kFirstFrameAfterRestart_s = 0.5;  // between the restart and the first frame [design]

// ---- acceptance of a package, and parts that are tried again [design]
inline constexpr double kLanded_s = 10;     // of heartbeats that say "disarmed"
inline constexpr double kFirstRetry_s = 1;  // after a part has failed; then twice as long each time
inline constexpr double kLastRetry_s = 30;  // at most

// ---- attitude of an autopilot that navigates by our fix, one sigma: the airframe file's figures were measured with
// GPS, and are used only where they are larger [loop]
inline constexpr double kFixAidedHeading_rad = 0.087;  // 5 degrees
inline constexpr double kFixAidedTilt_rad = 0.035;     // 2 degrees

}  // namespace nadir
