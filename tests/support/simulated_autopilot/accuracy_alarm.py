"""ArduPilot's alarm about the speed accuracy of the receiver in use: EKF_STATUS_REPORT flags a GPS glitch.

From AP_NavEKF3_VehicleStatus.cpp, calcGpsGoodForFlight: low-passed, its peak held with 10 s; on above 1.5 m/s, off below 1.
"""
SHARE, HOLD_S, ON, OFF = 0.2, 10.0, 1.5, 1.0


class AccuracyAlarm:
    def __init__(self):
        self.on = False
        self._smooth, self._peak, self._last_s = 0.0, 0.0, None

    def update(self, now_s, speed_accuracy):
        """speed_accuracy: m/s, None when the receiver reports none."""
        dt = 0.0 if self._last_s is None else now_s - self._last_s
        self._last_s = now_s
        self._smooth = min(10.0, SHARE * (speed_accuracy or 0.0) + (1 - SHARE) * self._smooth)
        self._peak = max(self._smooth, (1 - min(1.0, dt / HOLD_S)) * self._peak)
        if self._peak > ON:
            self.on = True
        elif self._peak < OFF:
            self.on = False
