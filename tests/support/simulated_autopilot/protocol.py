"""What others ask of the autopilot: parameters, commands, the signing key, GPS_INPUT."""
from pymavlink.dialects.v20 import ardupilotmega as dialect

FLOAT = dialect.MAV_PARAM_TYPE_REAL32
SIGNING_MINUTE = 6_000_000  # ArduPilot starts this far ahead of the time that it was given
# Those that provisioning looks at, as a fresh aircraft has them.
PARAMETERS = {"GPS1_TYPE": 14, "GPS2_TYPE": 1, "GPS1_DELAY_MS": 0, "GPS2_DELAY_MS": 0, "GPS_AUTO_SWITCH": 4, "GPS_PRIMARY": 0,
              "EK3_ENABLE": 1, "AHRS_EKF_TYPE": 3,
              "EK3_SRC1_POSXY": 3, "EK3_SRC1_VELXY": 3, "EK3_SRC1_POSZ": 1, "EK3_SRC1_VELZ": 3, "EK3_SRC1_YAW": 1,
              "EK3_GPS_CHECK": 31, "EK3_POS_I_GATE": 500, "EK3_VEL_I_GATE": 500, "EK3_GLITCH_RAD": 25,
              "SERIAL2_PROTOCOL": 2, "SERIAL2_BAUD": 921, "SYSID_THISMAV": 1, "BRD_OPTIONS": 0, "ARMING_CHECK": 1}


class Protocol:
    """ArduPilot's."""

    def __init__(self, vehicle, link, faults=()):
        """faults, for the tests of provisioning: "param-silent", "param-refuses", "param-refuses=NAME", "command-silent",
        "no-version", "imu-slow" (5 Hz whatever is asked), "gps-input-deaf", "signing-deaf", "signing-missed"
        (the first key alone)."""
        self.vehicle, self.link, self.faults = vehicle, link, set(faults)
        self.parameters = dict(PARAMETERS)
        self.received = {}

    def set_text(self, name, text):
        """From the command line."""
        self.parameters[name] = float(text)

    def handle(self, message):
        kind = message.get_type()
        self.received[kind] = self.received.get(kind, 0) + 1
        target = getattr(message, "target_system", 0)
        if target not in (0, self.link.mav.srcSystem):
            return
        handler = getattr(self, "_" + kind.lower(), None)
        if handler is not None:
            handler(message)

    def _gps_input(self, message):
        if "gps-input-deaf" not in self.faults:
            self.vehicle.receive_gps_input(message)

    def _statustext(self, message):
        self.vehicle.log.event(self.vehicle.now_s, "statustext", text=message.text.rstrip("\0"),
                               severity=message.severity)

    def _timesync(self, message):
        if message.tc1 == 0:
            self.link.send(dialect.MAVLink_timesync_message(self.vehicle.boot_ms() * 1_000_000, message.ts1))

    def _param_request_list(self, _message):
        if "param-silent" not in self.faults:
            for name in self.parameters:
                self._send_parameter(name)

    def _param_request_read(self, message):
        if "param-silent" in self.faults:
            return
        names = list(self.parameters)
        if message.param_index >= 0:
            name = names[message.param_index] if message.param_index < len(names) else None
        else:
            name = message.param_id.rstrip("\0")
        if name in self.parameters:
            self._send_parameter(name)

    def _param_set(self, message):
        name = message.param_id.rstrip("\0")
        if "param-silent" in self.faults or name not in self.parameters:
            return
        if not {"param-refuses", f"param-refuses={name}"} & self.faults:
            self.parameters[name] = message.param_value
            self.vehicle.log.event(self.vehicle.now_s, "parameter", name=name, value=message.param_value)
        self._send_parameter(name)

    def _send_parameter(self, name):
        self.link.send(dialect.MAVLink_param_value_message(
            name.encode(), self.parameters[name], FLOAT, len(self.parameters), list(self.parameters).index(name)))

    def _setup_signing(self, message):
        if "signing-missed" in self.faults:
            self.faults.discard("signing-missed")
            return
        if "signing-deaf" in self.faults or self.vehicle.armed:  # as ArduPilot: no key while it is armed
            return
        key = bytes(message.secret_key)
        installed = any(key) or message.initial_timestamp != 0  # zeros at any other time are a key to ArduPilot
        if installed:
            self.link.sign(key, message.initial_timestamp + SIGNING_MINUTE)
        else:
            self.link.stop_signing()
        self.vehicle.log.event(self.vehicle.now_s, "signing", text="installed" if installed else "removed")

    def _command_long(self, message):
        self._command(message, [getattr(message, f"param{i}") for i in range(1, 8)])

    def _command_int(self, message):
        self._command(message, [message.param1, message.param2, message.param3, message.param4, message.x, message.y,
                                message.z])

    def _command(self, message, parameters):
        if "command-silent" in self.faults:
            return
        result = self._carry_out(message.command, parameters)
        self.link.send(dialect.MAVLink_command_ack_message(message.command, result, 0, 0, message.get_srcSystem(),
                                                           message.get_srcComponent()))

    def _carry_out(self, command, parameters):
        accepted, denied = dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_DENIED
        if command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            slow = "imu-slow" in self.faults and _name(parameters[0]) in ("RAW_IMU", "HIGHRES_IMU")
            known = self.vehicle.telemetry.set_interval(_name(parameters[0]), 200_000 if slow else parameters[1])
            return accepted if known else denied
        if command == dialect.MAV_CMD_REQUEST_MESSAGE:
            name = _name(parameters[0])
            if name is None or not hasattr(self.vehicle.telemetry, name.lower()) or (
                    name == "AUTOPILOT_VERSION" and "no-version" in self.faults):
                return denied
            message = self.vehicle.telemetry.build(name)
            if message is not None:
                self.link.send(message)
            return accepted
        if command == dialect.MAV_CMD_COMPONENT_ARM_DISARM:
            self.vehicle.armed = parameters[0] == 1
            return accepted
        if command == dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN:
            if self.vehicle.armed:
                return denied
            self.vehicle.booted_s = self.vehicle.now_s
            self.vehicle.log.event(self.vehicle.now_s, "restart")
            return accepted
        if command == dialect.MAV_CMD_EXTERNAL_POSITION_ESTIMATE:
            self.vehicle.log.event(self.vehicle.now_s, "external_position", lat=parameters[4] * 1e-7,
                                   lon=parameters[5] * 1e-7, accuracy_m=parameters[2])
            return accepted
        return dialect.MAV_RESULT_UNSUPPORTED


def _name(message_id):
    kind = dialect.mavlink_map.get(int(message_id))
    return None if kind is None else kind.msgname
