"""What others ask of PX4: parameters by its rules, commands, its signing key, positions.

From PX4's sources, src/modules/mavlink: integers are copied bytewise into the float field, and PARAM_SET of another type
than the parameter's is not answered (mavlink_parameters.cpp); ODOMETRY is taken from any estimator but an autopilot's
(mavlink_receiver.cpp); TIMESYNC is answered, and until a peer answers ours, measurements count as of their arrival
(mavlink_timesync.cpp). SETUP_SIGNING exists from 1.18 on, and is refused while armed.
"""
import struct

from pymavlink.dialects.v20 import ardupilotmega as dialect

from .protocol import Protocol
from .px4_projection import MapProjection

INT, FLOAT = dialect.MAV_PARAM_TYPE_INT32, dialect.MAV_PARAM_TYPE_REAL32
SIGNS_FROM = AUXILIARY_FROM = (1, 18)

# As a fresh aircraft has them: src/modules/ekf2/params_*.yaml. Integers are int, the others float.
PARAMETERS = {"EKF2_EN": 1, "EKF2_GPS_CTRL": 7, "EKF2_GPS_P_NOISE": 0.5, "EKF2_GPS_P_GATE": 5.0, "EKF2_GPS_V_GATE": 5.0,
              "EKF2_HGT_REF": 1, "EKF2_EV_CTRL": 0, "EKF2_EV_NOISE_MD": 0, "EKF2_EV_QMIN": 0, "EKF2_EV_DELAY": 0.0,
              "EKF2_EVP_GATE": 5.0, "EKF2_EVP_NOISE": 0.1, "MAV_SYS_ID": 1, "MAV_1_CONFIG": 102, "MAV_1_MODE": 2}
SLOT = {"ID": 0, "CTRL": 0, "MODE": 0, "DELAY": 0.0, "NOISE": 1.0, "GATE": 3.0}
SLOTS = 4


def parameters(version):
    slots = {f"EKF2_AGP{i}_{name}": value for i in range(SLOTS) for name, value in SLOT.items()}
    return {**PARAMETERS, **({**slots, "EKF2_SENS_EN": 8191} if version >= AUXILIARY_FROM else {})}


def to_wire(value):
    return struct.unpack("<f", struct.pack("<i", value))[0] if isinstance(value, int) else value


def from_wire(field, kind):
    return struct.unpack("<i", struct.pack("<f", field))[0] if kind == INT else field


class Px4Protocol(Protocol):
    def __init__(self, vehicle, link, faults=()):
        """faults beside those of Protocol: "estimator-silent", "no-sensor-mask" (as before the release of 1.18)."""
        super().__init__(vehicle, link, faults)
        self.version = vehicle.options.px4_version
        self.parameters = parameters(self.version)
        if "no-sensor-mask" in self.faults:
            del self.parameters["EKF2_SENS_EN"]

    def set_text(self, name, text):
        """From the command line."""
        self.parameters[name] = type(self.parameters[name])(float(text))

    def _param_set(self, message):
        name = message.param_id.rstrip("\0")
        if "param-silent" in self.faults or name not in self.parameters:
            return
        kind = INT if isinstance(self.parameters[name], int) else FLOAT
        if message.param_type != kind:
            return  # "param types mismatch"
        if not {"param-refuses", f"param-refuses={name}"} & self.faults:
            self.parameters[name] = from_wire(message.param_value, kind)
            self.vehicle.log.event(self.vehicle.now_s, "parameter", name=name, value=float(self.parameters[name]))
        self._send_parameter(name)

    def _send_parameter(self, name):
        value = self.parameters[name]
        self.link.send(dialect.MAVLink_param_value_message(
            name.encode(), to_wire(value), INT if isinstance(value, int) else FLOAT, len(self.parameters),
            list(self.parameters).index(name)))

    def _gps_input(self, _message):
        """Not in PX4's receiver."""

    def _global_position_sensor(self, message):
        if self.version >= AUXILIARY_FROM:
            self.vehicle.note_given(self.vehicle.navigation.receive_global_position(self.vehicle.now_s, message))

    def _odometry(self, message):
        if message.estimator_type in (dialect.MAV_ESTIMATOR_TYPE_UNKNOWN, dialect.MAV_ESTIMATOR_TYPE_NAIVE,
                                      dialect.MAV_ESTIMATOR_TYPE_VISION, dialect.MAV_ESTIMATOR_TYPE_VIO) and (
                                          message.frame_id == dialect.MAV_FRAME_LOCAL_NED):
            self.vehicle.note_given(self.vehicle.navigation.receive_odometry(self.vehicle.now_s, message))

    def _set_gps_global_origin(self, message):
        navigation = self.vehicle.navigation
        navigation.origin = MapProjection(message.latitude * 1e-7, message.longitude * 1e-7)
        navigation.origin_altitude = message.altitude * 1e-3
        self.vehicle.log.event(self.vehicle.now_s, "origin", lat=navigation.origin.lat_deg, lon=navigation.origin.lon_deg)
        self.link.send(self.vehicle.telemetry.gps_global_origin())

    def _setup_signing(self, message):
        if self.version < SIGNS_FROM or "signing-deaf" in self.faults or self.vehicle.armed:
            return
        key = bytes(message.secret_key)
        installed = any(key) or message.initial_timestamp != 0
        if installed:
            self.link.sign(key, message.initial_timestamp)
        else:
            self.link.stop_signing()
        self.vehicle.log.event(self.vehicle.now_s, "signing", text="installed" if installed else "removed")
