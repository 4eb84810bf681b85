"""PX4's telemetry in the mode Onboard (src/modules/mavlink/mavlink_main.cpp), as far as anybody here listens."""
from pymavlink.dialects.v20 import ardupilotmega as dialect

from .telemetry import Telemetry, e7

RATES = {"HEARTBEAT": 1, "SYS_STATUS": 5, "SYSTEM_TIME": 1, "TIMESYNC": 10, "ATTITUDE": 50, "GLOBAL_POSITION_INT": 50,
         "GPS_RAW_INT": 5, "HIGHRES_IMU": 50, "VFR_HUD": 10, "DISTANCE_SENSOR": 10, "ESTIMATOR_STATUS": 1}
AUTO_MISSION = (4 << 16) | (4 << 24)  # main and sub mode: src/modules/commander/px4_custom_mode.h
RELEASE = 255


class Px4Telemetry(Telemetry):
    RATES = RATES

    def heartbeat(self):
        mode = (dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_AUTO_ENABLED |
                dialect.MAV_MODE_FLAG_STABILIZE_ENABLED | dialect.MAV_MODE_FLAG_GUIDED_ENABLED)
        if self.vehicle.armed:
            mode |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
        return dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_FIXED_WING, dialect.MAV_AUTOPILOT_PX4, mode, AUTO_MISSION,
                                                 dialect.MAV_STATE_ACTIVE if self.vehicle.armed else
                                                 dialect.MAV_STATE_STANDBY, 3)

    def global_position_int(self):
        """None while PX4 has no origin."""
        return None if self.vehicle.navigation.origin is None else super().global_position_int()

    def timesync(self):
        return dialect.MAVLink_timesync_message(0, self.vehicle.boot_ms() * 1_000_000)

    def highres_imu(self):
        v = self.vehicle
        pull, rates = v.plane.take_inertial()
        force = [f + b for f, b in zip(pull, v.imu_bias())]
        return dialect.MAVLink_highres_imu_message(v.boot_ms() * 1000, *force, *rates, 0, 0, 0, 950, 3,
                                                   v.navigation.altitude(), 21, 0xFFFF)

    def estimator_status(self):
        if "estimator-silent" in self.vehicle.protocol.faults:
            return None
        navigation = self.vehicle.navigation
        flags = (dialect.ESTIMATOR_ATTITUDE | dialect.ESTIMATOR_VELOCITY_HORIZ | dialect.ESTIMATOR_VELOCITY_VERT |
                 dialect.ESTIMATOR_POS_HORIZ_REL | dialect.ESTIMATOR_POS_VERT_ABS)
        if navigation.origin is not None and 2 * navigation.filter.pp < 625:
            flags |= dialect.ESTIMATOR_POS_HORIZ_ABS
        if navigation.gnss.rejected:
            flags |= dialect.ESTIMATOR_GPS_GLITCH
        return dialect.MAVLink_estimator_status_message(self.vehicle.boot_ms() * 1000, flags, 0.1,
                                                        min(10.0, navigation.filter.ratio), 0.1, 0.1, 0.0, 0.1,
                                                        navigation.filter.sigma(), 1.0)

    def gps_global_origin(self):
        """None while PX4 has none."""
        navigation = self.vehicle.navigation
        if navigation.origin is None:
            return None
        return dialect.MAVLink_gps_global_origin_message(
            e7(navigation.origin.lat_deg), e7(navigation.origin.lon_deg), round(navigation.origin_altitude * 1000),
            self.vehicle.boot_ms() * 1000)

    def autopilot_version(self):
        capabilities = (dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2 | dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT |
                        dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE)
        major, minor = self.vehicle.options.px4_version
        uid = list(self.vehicle.uid) + [0] * (18 - len(self.vehicle.uid))
        return dialect.MAVLink_autopilot_version_message(
            capabilities, major << 24 | minor << 16 | RELEASE, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0x26AC, 0x0032, 0, uid)
