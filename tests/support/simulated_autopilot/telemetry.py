"""The autopilot's telemetry and its rates. SET_MESSAGE_INTERVAL changes the rates, as on the real one."""
import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from .gps_input import GpsInputReceiver

# Messages a second.
RATES = {"HEARTBEAT": 1, "SYS_STATUS": 2, "SYSTEM_TIME": 2, "ATTITUDE": 25, "GLOBAL_POSITION_INT": 10, "GPS_RAW_INT": 5,
         "GPS2_RAW": 5, "RAW_IMU": 50, "SCALED_PRESSURE": 10, "VFR_HUD": 10, "WIND": 2, "TERRAIN_REPORT": 5,
         "DISTANCE_SENSOR": 10, "EKF_STATUS_REPORT": 5}
PLANE_MODE_AUTO = 10
LIDAR_MAX_M = 120.0


def e7(degrees):
    return round(degrees * 1e7)


def within(value, low, high):
    return max(low, min(high, round(value)))


def cdeg(radians):
    return within(math.degrees(radians) % 360 * 100, 0, 35999)


class Telemetry:
    RATES = RATES

    def __init__(self, vehicle):
        self.vehicle = vehicle
        self.periods = {name: 1 / rate for name, rate in self.RATES.items()}
        self.next = dict.fromkeys(self.RATES, 0.0)

    def set_interval(self, name, interval_us):
        """MAV_CMD_SET_MESSAGE_INTERVAL: 0 the usual rate, -1 never. False: no such message here."""
        if name not in self.RATES:
            return False
        self.periods[name] = 1 / self.RATES[name] if interval_us == 0 else math.inf if interval_us < 0 else interval_us * 1e-6
        self.next[name] = self.vehicle.now_s
        return True

    def due(self, now_s):
        for name, period in self.periods.items():
            if period < math.inf and now_s >= self.next[name]:
                self.next[name] = max(self.next[name] + period, now_s - period)
                message = self.build(name)
                if message is not None:
                    yield message

    def build(self, name):
        return getattr(self, name.lower())()

    def heartbeat(self):
        mode = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | dialect.MAV_MODE_FLAG_AUTO_ENABLED
        if self.vehicle.armed:
            mode |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
        return dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_FIXED_WING, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, mode,
                                                 PLANE_MODE_AUTO, dialect.MAV_STATE_ACTIVE, 3)

    def sys_status(self):
        gps = dialect.MAV_SYS_STATUS_SENSOR_GPS
        healthy = gps if self.vehicle.navigation.source != "none" else 0
        return dialect.MAVLink_sys_status_message(gps, gps, healthy, 200, 11800, 900, 80, 0, 0, 0, 0, 0, 0)

    def system_time(self):
        return dialect.MAVLink_system_time_message(self.vehicle.unix_us(), self.vehicle.boot_ms())

    def attitude(self):
        roll, pitch, yaw = self.vehicle.estimated_attitude()
        return dialect.MAVLink_attitude_message(self.vehicle.boot_ms(), roll, pitch, yaw, *self.vehicle.plane.rates)

    def global_position_int(self):
        v = self.vehicle
        n, e = v.navigation.filter.position
        lat, lon = v.local.to_degrees(n, e)
        vn, ve = v.navigation.filter.velocity
        altitude = v.navigation.altitude()
        return dialect.MAVLink_global_position_int_message(
            v.boot_ms(), e7(lat), e7(lon), round(altitude * 1000), round((altitude - v.home_altitude) * 1000),
            within(vn * 100, -32768, 32767), within(ve * 100, -32768, 32767),
            within(v.plane.velocity[2] * 100, -32768, 32767), cdeg(v.estimated_attitude()[2]))

    def gps_raw_int(self):
        return self._gps(0)

    def gps2_raw(self):
        return self._gps(1)

    def _gps(self, instance):
        v = self.vehicle
        given: GpsInputReceiver = v.navigation.given
        sample = given.sample if given.instance == instance else v.navigation.own_sample
        kind = dialect.MAVLink_gps2_raw_message if instance else dialect.MAVLink_gps_raw_int_message
        extra = (0, 0) if instance else ()  # dgps_numch, dgps_age
        if sample is None or sample.fix_type < 2:
            fix = 0 if sample is None else min(1, sample.fix_type)
            return kind(v.boot_ms() * 1000, fix, 0, 0, 0, 9999, 9999, 0, 0, 0, *extra)
        lat, lon = v.local.to_degrees(sample.north, sample.east)
        speed, course = 0xFFFF, 0xFFFF
        if sample.velocity is not None:
            speed = within(math.hypot(*sample.velocity[:2]) * 100, 0, 65534)
            course = cdeg(math.atan2(sample.velocity[1], sample.velocity[0]))
        accuracies = [0 if a is None else within(a * 1000, 0, 2 ** 32 - 1) for a in (sample.h_acc, sample.v_acc,
                                                                                     sample.s_acc)]
        common = (v.boot_ms() * 1000, within(sample.fix_type, 0, 8), e7(lat), e7(lon),
                  round((sample.altitude or 0) * 1000), within(sample.hdop * 100, 0, 65535), 9999, speed, course,
                  within(sample.satellites, 0, 255))
        if instance:
            return kind(*common, *extra, 0, 0, *accuracies, 0)
        return kind(*common, 0, *accuracies, 0, 0)

    def raw_imu(self):
        v = self.vehicle
        pull, turned = v.plane.take_inertial()
        force = [round((f + b) / 9.80665 * 1000) for f, b in zip(pull, v.imu_bias())]
        rates = [round(rate * 1000) for rate in turned]
        clipped = [within(number, -32768, 32767) for number in (*force, *rates)]
        return dialect.MAVLink_raw_imu_message(v.boot_ms() * 1000, *clipped, 0, 0, 0, 0, 3500)

    def scaled_pressure(self):
        altitude = self.vehicle.navigation.altitude()
        pressure = 1013.25 * (1 - 2.25577e-5 * altitude) ** 5.25588
        return dialect.MAVLink_scaled_pressure_message(self.vehicle.boot_ms(), pressure,
                                                       0.00613 * self.vehicle.plane.airspeed ** 2, 2100)

    def vfr_hud(self):
        v = self.vehicle
        ground = math.hypot(*v.navigation.filter.velocity)
        heading = round(math.degrees(v.estimated_attitude()[2])) % 360
        return dialect.MAVLink_vfr_hud_message(v.plane.airspeed, ground, heading, 55, v.navigation.altitude(),
                                               v.plane.climb)

    def wind(self):
        north, east = self.vehicle.navigation.filter.wind
        return dialect.MAVLink_wind_message(math.degrees(math.atan2(-east, -north)) % 360, math.hypot(north, east), 0)

    def terrain_report(self):
        v = self.vehicle
        lat, lon = v.local.to_degrees(*v.navigation.filter.position)
        ground = v.terrain.height(lat, lon)
        return dialect.MAVLink_terrain_report_message(e7(lat), e7(lon), 100, ground, v.navigation.altitude() - ground, 0,
                                                      50)

    def distance_sensor(self):
        v = self.vehicle
        height = v.height_above_ground()
        if height > LIDAR_MAX_M:
            return None  # out of its range
        slant = height / max(0.2, math.cos(v.plane.roll) * math.cos(v.plane.pitch))
        return dialect.MAVLink_distance_sensor_message(v.boot_ms(), 20, round(LIDAR_MAX_M * 100), round(slant * 100),
                                                       dialect.MAV_DISTANCE_SENSOR_LASER, 0,
                                                       dialect.MAV_SENSOR_ROTATION_PITCH_270, 0)

    def ekf_status_report(self):
        navigation = self.vehicle.navigation
        flags = (dialect.EKF_ATTITUDE | dialect.EKF_VELOCITY_HORIZ | dialect.EKF_VELOCITY_VERT | dialect.EKF_POS_VERT_ABS |
                 dialect.EKF_POS_HORIZ_REL)
        if navigation.source != "none" or 2 * navigation.filter.pp < 625:
            flags |= dialect.EKF_POS_HORIZ_ABS | dialect.EKF_PRED_POS_HORIZ_ABS
        if navigation.filter.ratio >= 1 or navigation.accuracy_alarm.on:
            flags |= dialect.EKF_GPS_GLITCHING
        variance = min(10.0, math.sqrt(navigation.filter.ratio))
        return dialect.MAVLink_ekf_status_report_message(flags, 0.1, variance, 0.1, 0.05, 0.0, 0.0)

    def sim_state(self):
        """The truth, for the camera's renderer."""
        v = self.vehicle
        p = v.plane
        lat, lon = v.local.to_degrees(p.north, p.east)
        return dialect.MAVLink_sim_state_message(
            1, 0, 0, 0, p.roll, p.pitch, p.yaw, *p.specific_force(), *p.rates, lat, lon, p.altitude, 0, 0, *p.velocity,
            e7(lat), e7(lon))

    def autopilot_version(self):
        capabilities = (dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2 | dialect.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT |
                        dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT)
        uid = list(self.vehicle.uid) + [0] * (18 - len(self.vehicle.uid))
        return dialect.MAVLink_autopilot_version_message(capabilities, 0x040601FF, 0, 0, 140 << 16, [0] * 8, [0] * 8,
                                                         [0] * 8, 0x1209, 0x5740, 0, uid)
