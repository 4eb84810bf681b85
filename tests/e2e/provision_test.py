#!/usr/bin/env python3
"""`nadir provision autopilot` as a user calls it, against the simulated autopilot over UDP and a pseudo-terminal."""
import base64
import concurrent.futures
import json
import os
import signal
import stat
import subprocess
import sys
import time
import tty

import support
from loop.ports import free_port

AUTOPILOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support", "autopilot.py")
WRONG = {"GPS1_TYPE": 1, "GPS1_DELAY_MS": 0, "EK3_SRC1_POSXY": 0, "EK3_SRC1_YAW": 8}


class Provisioning(support.EndToEnd):
    """What the tests share: an autopilot, and the command."""

    def setUp(self):
        super().setUp()
        self.port = free_port()
        self.url = f"udpin:127.0.0.1:{self.port}"
        self.log = self.folder / "autopilot.log"
        self.process = None
        self.key = self.folder / "link.key"
        self.out = self.folder / "falcon-7"
        (self.folder / "camera.yaml").write_text(support.CAMERA.format(width=320, height=240))
        (self.folder / "waypoints.csv").write_text("lat_deg,lon_deg\n47.3995,8.4985\n47.3995,8.5015\n47.4005,8.5015\n")
        self.good("keys", "create", "--out", self.folder / "planner")

    def start(self, *more, link=None, parameters=WRONG, disarmed=True):
        args = [sys.executable, "-B", AUTOPILOT, "--link", link or f"udpout:127.0.0.1:{self.port}", "--waypoints",
                self.folder / "waypoints.csv", "--altitude-m", "100", "--duration", "100000", *more]
        args += [f"--parameter={name}={value}" for name, value in parameters.items()]
        with open(self.log, "w", encoding="utf-8") as log:
            self.process = subprocess.Popen([*map(str, args + ["--disarmed"] * disarmed)], stdout=log,
                                            stdin=subprocess.DEVNULL)
        self.addCleanup(self.process.wait)
        self.addCleanup(self.process.kill)
        while not self.log.stat().st_size:  # it reports immediately who navigates
            self.assertIsNone(self.process.poll())
            time.sleep(0.01)

    def events(self):
        """Stops the autopilot and returns what happened to its parameters and its key."""
        self.process.send_signal(signal.SIGTERM)
        self.process.wait()
        lines = [line.split() for line in self.log.read_text().splitlines()]
        return [line[2:] for line in lines if len(line) > 2 and line[2] in ("parameter", "signing", "restart")]

    def args(self, *more, patience=60):
        return ["provision", "autopilot", "--autopilot", self.url, "--timeout-s", patience, *more]

    def all_of_it(self):
        return ["--apply", "--signing-key", self.key, "--airframe", "falcon-7", "--camera", self.folder / "camera.yaml",
                "--key", self.folder / "planner.key.pem", "--out", self.out, "--sequence", "1", "--expires",
                "2035-01-01", "--mount-yaw-deg", "180",
                "--capture-delay-s", "0.08"]

    def parameters_now(self, events):
        now = dict(WRONG)
        for kind, *words in events:
            if kind == "parameter":
                now[words[0].removeprefix("name=")] = float(words[1].removeprefix("value="))
        return now

    def assert_untouched(self, key="removed"):
        """As before: every parameter restored, no key, no airframe file."""
        events = self.events()
        self.assertEqual(WRONG, self.parameters_now(events))
        keys = [line[1] for line in events if line[0] == "signing"]
        self.assertIn(keys[-1:], ([], ["text=" + key]))
        self.assertEqual([], [name for name in os.listdir(self.folder) if "falcon-7" in name])


class Provision(Provisioning):
    def test_shows_and_changes_nothing_without_apply(self):
        self.start()
        report = json.loads(self.good(*self.args("--signing-key", self.key, "--json")).stdout)
        self.assertFalse(report["applied"])
        self.assertEqual("4.6.1", report["version"])
        self.assertRegex(report["uid"], "^[0-9a-f]{36}$")
        found = {one["name"]: (one["found"], one["wanted"]) for one in report["parameters"]}
        self.assertEqual({"GPS1_TYPE": (1, 14), "GPS1_DELAY_MS": (0, 10), "EK3_SRC1_POSXY": (0, 3), "EK3_SRC1_VELXY": (3, 3),
                          "EK3_SRC1_POSZ": (1, 1), "EK3_SRC1_YAW": (8, 1)}, found)
        self.assertFalse(self.key.exists())
        self.assertEqual([], self.events())

    def test_provisions_and_then_again_over_the_signed_link(self):
        self.start()
        self.good(*self.args(*self.all_of_it()))
        self.assertEqual(0o600, stat.S_IMODE(self.key.stat().st_mode))
        self.assertEqual({"airframe.json", "airframe.json.sig"}, set(os.listdir(self.out)))
        text = (self.out / "airframe.json").read_bytes()
        airframe = json.loads(text)
        self.assertEqual(("falcon-7", 0.08, 250.0), (airframe["airframe"], airframe["capture_delay_s"],
                                                     airframe["camera"]["fx"]))
        self.assertEqual((1, "2035-01-01T00:00:00Z"), (airframe["sequence"], airframe["expires"]))
        self.check_signature(text)
        # From now on only peers with the key are accepted.
        self.fails(2, *self.args(patience=1), mentions=("autopilot",))
        report = json.loads(self.good(*self.args("--apply", "--signing-key", self.key, "--json")).stdout)
        self.assertFalse(report["key_installed"])
        self.assertGreaterEqual(report["imu_rate_hz"], 30)
        events = self.events()
        self.assertEqual({"GPS1_TYPE": 14, "GPS1_DELAY_MS": 10, "EK3_SRC1_POSXY": 3, "EK3_SRC1_YAW": 1},
                         self.parameters_now(events))
        self.assertEqual(["restart", "signing"], [line[0] for line in events if line[0] != "parameter"])
        self.assertNotIn(self.key.read_text().strip(), self.log.read_text())

    def test_a_key_that_the_autopilot_missed_is_sent_again(self):
        self.start("--fault", "signing-missed")
        report = json.loads(self.good(*self.args(*self.all_of_it(), "--json")).stdout)
        self.assertTrue(report["key_installed"])
        self.assertEqual(["restart", "signing"], [line[0] for line in self.events() if line[0] != "parameter"])

    def check_signature(self, text):
        """openssl verifies; the encoding is DSSE's."""
        envelope = json.loads((self.out / "airframe.json.sig").read_text())
        kind = envelope["payloadType"].encode()
        (self.folder / "signed").write_bytes(b"DSSEv1 %d %s %d %s" % (len(kind), kind, len(text), text))
        (self.folder / "sig").write_bytes(base64.b64decode(envelope["signatures"][0]["sig"]))
        subprocess.run(["openssl", "pkeyutl", "-verify", "-pubin", "-inkey", self.folder / "planner.pub.pem", "-rawin", "-in",
                        self.folder / "signed", "-sigfile", self.folder / "sig"], check=True, capture_output=True)

    def test_works_over_a_terminal(self):
        (our_cable, our_end), (their_cable, their_end) = os.openpty(), os.openpty()
        for end in (our_cable, our_end, their_cable, their_end):
            self.addCleanup(os.close, end)
            tty.setraw(end)
        relay = subprocess.Popen([sys.executable, "-c", RELAY, str(our_cable), str(their_cable)],
                                 pass_fds=(our_cable, their_cable))
        self.addCleanup(relay.wait)
        self.addCleanup(relay.kill)
        self.start(link="file:" + os.ttyname(their_end))
        self.url = f"serial:{os.ttyname(our_end)}:115200"
        report = json.loads(self.good(*self.args("--json")).stdout)
        self.assertEqual(1, report["system"])

    def test_no_autopilot_responds(self):
        self.fails(2, *self.args(*self.all_of_it(), patience=0.3), mentions=("no autopilot", self.url), leaves_nothing=self.out)

    def test_a_failed_step_is_explained_and_reverted(self):
        """In parallel: each mostly waits for its timeout."""
        faults = {"no-version": "AUTOPILOT_VERSION", "command-silent": "AUTOPILOT_VERSION", "param-silent": "GPS1_TYPE",
                  "param-refuses=EK3_SRC1_YAW": "EK3_SRC1_YAW", "signing-deaf": "does not sign", "imu-slow": "RAW_IMU",
                  "gps-input-deaf": "GPS_INPUT"}

        def one(fault):
            case = Provision(self._testMethodName)  # a folder, a port and an autopilot of its own
            self.addCleanup(case.doCleanups)
            case.setUp()
            case.start("--fault", fault)
            result = case.fails(2, *case.args(*case.all_of_it(), patience=8), mentions=(faults[fault], "expected", "found"))
            self.assertNotIn("not reverted", result.stderr)
            case.assert_untouched()

        with concurrent.futures.ThreadPoolExecutor(len(faults)) as pool:
            list(pool.map(one, faults))

    def test_an_armed_aircraft_is_left_alone(self):
        self.start(disarmed=False)
        self.fails(2, *self.args(*self.all_of_it()), mentions=("armed",))
        self.assert_untouched()

    def test_an_unwritable_file_reverts_all_changes(self):
        self.start()
        args = self.all_of_it()
        args[args.index(self.out)] = self.folder / "missing" / "falcon-7"
        self.fails(2, *self.args(*args), mentions=("missing", "were reverted"))
        self.assert_untouched()

    def test_an_interrupt_reverts_all_changes(self):
        self.start("--fault", "gps-input-deaf")
        process = subprocess.Popen([support.NADIR, *map(str, self.args(*self.all_of_it()))], stdin=subprocess.DEVNULL,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.addCleanup(process.stderr.close)
        self.addCleanup(process.kill)
        for line in process.stderr:
            if line == "the link is signed\n":  # and the smoke test cannot succeed
                process.send_signal(signal.SIGINT)
                break
        process.stderr.read()
        self.assertEqual(130, process.wait())
        self.assert_untouched()

    def test_an_autopilot_with_another_key_is_left_alone(self):
        other = self.folder / "other.key"
        other.write_text("ab" * 32 + "\n")
        self.start("--key-file", other)
        self.fails(2, *self.args(*self.all_of_it()), mentions=("another key",))
        self.assert_untouched()

    def test_rejects_invalid_input_before_connecting(self):
        apply = self.all_of_it()
        self.fails(2, *self.args(*apply[1:]), mentions=("--apply",))
        for missing in ("--sequence", "--expires"):
            at = apply.index(missing)
            self.fails(2, *self.args(*apply[:at], *apply[at + 2:]), mentions=("--sequence N and --expires DATE", "no " + missing))
        self.out.mkdir()
        self.fails(2, *self.args(*apply), mentions=("already exists",))
        self.out.rmdir()
        self.key.write_text("not a key\n")
        self.key.chmod(0o600)
        self.fails(2, *self.args(*apply), mentions=("no signing key",), leaves_nothing=self.out)
        self.key.chmod(0o644)
        self.fails(2, *self.args(*apply), mentions=("link.key",), leaves_nothing=self.out)
        (self.folder / "camera.yaml").write_text("model: fisheye\n")
        self.fails(2, *self.args(*apply), mentions=("camera.yaml",), leaves_nothing=self.out)


class Px4(Provisioning):
    """What differs with PX4."""
    WRONG = {"EKF2_AGP0_CTRL": 0, "EKF2_AGP0_GATE": 3.0, "EKF2_GPS_CTRL": 5, "EKF2_SENS_EN": 8191 - 16 - 64}
    WANTED = {"EKF2_AGP0_ID": 1, "EKF2_AGP0_CTRL": 1, "EKF2_AGP0_MODE": 0, "EKF2_AGP0_DELAY": 0, "EKF2_AGP0_GATE": 5,
              "EKF2_SENS_EN": 8191 - 64, "EKF2_HGT_REF": 0, "EKF2_GPS_CTRL": 5}

    def start_px4(self, *more, version="1.18", parameters=None, disarmed=True):
        self.start("--px4", version, *more, parameters=self.WRONG if parameters is None else parameters, disarmed=disarmed)

    def now(self, events):
        return {words[0].removeprefix("name="): float(words[1].removeprefix("value="))
                for kind, *words in events if kind == "parameter"}

    def test_shows_and_changes_nothing_without_apply(self):
        self.start_px4()
        report = json.loads(self.good(*self.args("--json")).stdout)
        self.assertEqual(("PX4", "1.18.0", False), (report["autopilot"], report["version"], report["applied"]))
        self.assertEqual(self.WANTED, {one["name"]: one["wanted"] for one in report["parameters"]})
        found = {one["name"]: one["found"] for one in report["parameters"]}
        self.assertEqual((0, 3, 5, 1), tuple(found[name] for name in ("EKF2_AGP0_ID", "EKF2_AGP0_GATE", "EKF2_GPS_CTRL",
                                                                     "EKF2_HGT_REF")))
        self.assertEqual([], self.events())

    def test_provisions_and_then_again_over_the_signed_link(self):
        self.start_px4()
        self.good(*self.args(*self.all_of_it()))
        airframe = json.loads((self.out / "airframe.json").read_bytes())
        self.assertEqual(self.WANTED, {one["name"]: one["value"] for one in airframe["mavlink"]["parameters"]})
        report = json.loads(self.good(*self.args("--apply", "--signing-key", self.key, "--json")).stdout)
        self.assertFalse(report["key_installed"] or report["restarted"], "all is as it should be")
        self.assertGreaterEqual(report["imu_rate_hz"], 30)
        events = self.events()
        self.assertEqual({"EKF2_AGP0_ID": 1, "EKF2_AGP0_CTRL": 1, "EKF2_AGP0_GATE": 5, "EKF2_SENS_EN": 8191 - 64, "EKF2_HGT_REF": 0},
                         self.now(events))
        self.assertEqual(["restart", "signing"], [line[0] for line in events if line[0] != "parameter"])

    def test_a_development_version_without_a_mask_of_sensors_needs_none(self):
        self.start_px4("--fault", "no-sensor-mask", parameters={"EKF2_GPS_CTRL": 5})
        report = json.loads(self.good(*self.args("--json")).stdout)
        expected = {name: value for name, value in self.WANTED.items() if name != "EKF2_SENS_EN"}
        self.assertEqual(expected, {one["name"]: one["wanted"] for one in report["parameters"]})

    def test_before_1_18_external_vision_is_set_and_no_key(self):
        self.start_px4(version="1.17", parameters={"EKF2_EV_CTRL": 15})
        self.fails(2, *self.args("--apply", "--signing-key", self.key), mentions=("cannot sign", "PX4 1.17.0"))
        report = json.loads(self.good(*self.args("--apply", "--json")).stdout)
        self.assertTrue(report["restarted"])
        self.assertEqual({"EKF2_EV_CTRL": 1, "EKF2_HGT_REF": 0}, self.now(self.events()))

    def test_a_failed_step_is_explained_and_reverted(self):
        faults = {"param-refuses=EKF2_AGP0_GATE": "EKF2_AGP0_GATE", "imu-slow": "HIGHRES_IMU",
                  "estimator-silent": "ESTIMATOR_STATUS", "signing-deaf": "does not sign"}

        def one(fault):
            case = Px4(self._testMethodName)
            self.addCleanup(case.doCleanups)
            case.setUp()
            case.start_px4("--fault", fault)
            result = case.fails(2, *case.args(*case.all_of_it(), patience=8), mentions=(faults[fault], "expected", "found"))
            self.assertNotIn("not reverted", result.stderr)
            before = {"EKF2_AGP0_ID": 0, "EKF2_AGP0_CTRL": 0, "EKF2_AGP0_GATE": 3, "EKF2_SENS_EN": self.WRONG["EKF2_SENS_EN"],
                      "EKF2_HGT_REF": 1}
            after = case.now(case.events())
            self.assertEqual({name: before[name] for name in after}, after)

        with concurrent.futures.ThreadPoolExecutor(len(faults)) as pool:
            list(pool.map(one, faults))

    def test_an_armed_aircraft_is_left_alone(self):
        self.start_px4(disarmed=False)
        self.fails(2, *self.args(*self.all_of_it()), mentions=("armed",))
        self.assertEqual([], self.events())


# Between two terminals, as a cable.
RELAY = """
import os, select, sys
ends = [int(word) for word in sys.argv[1:]]
while True:
    for end in select.select(ends, [], [])[0]:
        os.write(ends[1 - ends.index(end)], os.read(end, 65536))
"""

if __name__ == "__main__":
    support.main()
