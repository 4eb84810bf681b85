"""Who sits on the network between autopilot, companion computer and ground station, with the link's key or without."""
import os
import random
import socket
import threading
import time

from pymavlink.dialects.v20 import ardupilotmega as dialect

from .aircraft import KEY, YEAR, Aircraft, LinkEndpoint, gps2, heartbeat, hint, signing_time, telemetry
from .registry import attack
from .shared import free_port

FAR = 48.9  # a degree and a half north of where the aircraft is


def steal(scene, aircraft, rival, arrived):
    """The rival speaks as the autopilot for 2 s; the fixes must go on to the autopilot alone."""
    since = time.monotonic()
    while time.monotonic() - since < 2:
        rival.send(heartbeat(), *telemetry(since, lat=FAR))
        time.sleep(0.05)
    scene.attacked(scene.wait_for(arrived, 5), f"no frame of the rival was noticed: {aircraft.link()}")
    scene.holds(rival.count("GPS_INPUT") == 0, f"the rival was given {rival.count('GPS_INPUT')} fixes")
    aircraft.flies_on(since)
    given = aircraft.autopilot.count("GPS_INPUT", since)
    scene.holds(given >= 10, f"the autopilot was given {given} fixes in 2 s")
    return f"autopilot {given} GPS_INPUT, rival none"


@attack("H4")
def last_sender_takes_the_fixes(scene):
    """On an unsigned link somebody with the autopilot's ids speaks from another address, to be sent the fixes."""
    with Aircraft(scene, signed=False, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        rival = aircraft.endpoint()
        answer = steal(scene, aircraft, rival, lambda: aircraft.link().get("rivals", 0) > 0)
        scene.wait_for(lambda: any("second" in text.lower() or "rival" in text.lower() or "another" in text.lower() for text in aircraft.texts()), 12,
                       "the second sender is not reported to the operator")
        return f"{answer}; {aircraft.link()['rivals']} frames counted as rival's"


@attack("H4")
def rival_without_the_key(scene):
    """The same on a signed link, without the key, and then with another key."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        steal(scene, aircraft, aircraft.endpoint(), lambda: aircraft.rejected() > 10)
        before = aircraft.rejected()
        answer = steal(scene, aircraft, aircraft.endpoint(key=bytes(range(32))), lambda: aircraft.rejected() > before + 10)
        return f"{answer}; {aircraft.rejected()} frames refused"


@attack("H4")
def rival_with_the_key(scene):
    """The same by somebody who has stolen the link's key: even so the fixes stay with the configured autopilot."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        rival = aircraft.endpoint(key=KEY, link_id=9)
        return steal(scene, aircraft, rival, lambda: aircraft.link().get("rivals", 0) > 0)


@attack("H5")
def unsigned_link_by_omission(scene):
    """nadird is started without a key; whoever forgets it must not fly unsigned."""
    shared = scene.shared
    ran = scene.run("nadird", "--package", shared.built(), "--trust", shared.root, "--airframe", shared.airframe(scene.folder),
                    "--state", scene.folder / "state", "--camera", f"folder:{scene.folder}", "--autopilot",
                    f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}", "--listen", f"127.0.0.1:{free_port()}", limit_s=8)
    scene.attacked(ran.said, "it said nothing")
    return f"{scene.rejected(ran, '--unsigned-link', code=2)} has to be said"


@attack("H5")
def unsigned_link_says_nothing(scene):
    """An unsigned link must say so on the page and as an event, and never "is who it says"."""
    with Aircraft(scene, signed=False, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        scene.attacked(aircraft.link()["signed"] is False, "the link is signed")
        scene.wait_for(lambda: any("not signed" in text for text in aircraft.texts()), 5, f"no event says it: {aircraft.texts()}")
        scene.holds(not any("authenticated" in text for text in aircraft.texts()), "an event says that the autopilot is authenticated")
        scene.wait_for(lambda: any("NOT SIGNED" in getattr(message, "text", "") for _, message in aircraft.autopilot.received), 5,
                       "nothing is reported to the operator")
        return next(text for text in aircraft.texts() if "not signed" in text)


def judgement(aircraft):
    return ((aircraft.get() or {}).get("gps") or {}).get("judgement")


@attack("H5")
def injected_gps(scene):
    """Another system on an unsigned link sends GPS2_RAW far away, so that the aircraft distrusts a good receiver."""
    with Aircraft(scene, signed=False, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        before = judgement(aircraft)
        injector, same_ids = aircraft.endpoint(system=2, component=1), aircraft.endpoint()
        until = time.monotonic() + 4
        while time.monotonic() < until:
            injector.send(gps2(lat=FAR))
            same_ids.send(gps2(lat=FAR))
            time.sleep(0.05)
            scene.holds(judgement(aircraft) != "spoofed", "one injected GPS2_RAW makes the GPS \"spoofed\"")
        scene.attacked(aircraft.link().get("rivals", 0) > 0, "no frame was noticed")
        return f"GPS {before} before, {judgement(aircraft)} after"


@attack("H5")
def hint_for_another_system(scene):
    """A position hint (COMMAND_INT) addressed to system 42, component 42 is accepted."""
    with Aircraft(scene, signed=False, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        station = aircraft.endpoint(system=255, component=190)
        for _ in range(5):
            station.send(hint(42, 42))
        time.sleep(1.5)
        accepted = [text for text in aircraft.texts() if "255/190" in text]
        # The same, addressed to us, is taken: so the frame was sound.
        station.send(hint())
        scene.attacked(scene.wait_for(lambda: any("255/190" in text for text in aircraft.texts()), 5),
                       f"the frame is not sound: {aircraft.texts()}")
        scene.holds(not accepted, f"it was taken: {accepted}")
        return "not taken; our own is, with its sender: " + next(text for text in aircraft.texts() if "255/190" in text)[:60]


@attack("L1")
def replay_after_a_restart(scene):
    """All frames of the autopilot are recorded; nadird is killed and started again, and receives the recording first."""
    state, port = scene.folder / "state", free_port(socket.SOCK_DGRAM)
    with Aircraft(scene, state=state, autopilot=True, link_port=port) as aircraft:
        aircraft.has_package().connected()
        time.sleep(2.5)
        recorded = list(aircraft.autopilot.sent)
        aircraft.autopilot.stopped.set()
        time.sleep(1.3)
        scene.end(aircraft.service, number=9)
    with Aircraft(scene, state=state, link_port=port) as aircraft:
        aircraft.has_package()
        rival = aircraft.endpoint()
        for data in recorded:
            rival.send_bytes(data)
            time.sleep(0.005)
        scene.attacked(scene.wait_for(lambda: aircraft.rejected() >= 10, 5), f"the recording did not arrive: {aircraft.link()}")
        scene.holds(not aircraft.link().get("connected"), "the recording counts as the autopilot's first contact")
        scene.holds(rival.count("GPS_INPUT") == 0, "the replayer is sent the fixes")
        return f"{aircraft.rejected()} of {len(recorded)} frames refused, not connected"


@attack("H3")
def frame_ten_years_ahead(scene):
    """One frame signed with the right key, dated ten years ahead, and then two years behind."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        for ahead_s in (10 * YEAR, 10 * YEAR, -2 * YEAR):
            rival = aircraft.endpoint(component=50, key=KEY, ahead_s=ahead_s, link_id=7)
            rival.send(heartbeat())
        scene.attacked(scene.wait_for(lambda: aircraft.rejected() >= 2, 5), f"nothing was refused: {aircraft.link()}")
        since = time.monotonic()
        time.sleep(2.2)
        aircraft.flies_on(since)
        scene.holds(aircraft.link()["connected"], "the autopilot is not received any more")
        kept = int((aircraft.state_folder / "signing-time").read_text().split()[0])
        scene.holds(kept < signing_time(2 * 86400), "the time on the disk is years ahead")
        reasons = ", ".join(f"{count} {reason}" for reason, count in aircraft.link()["rejected_by"].items() if count)
        return f"refused ({reasons}); the autopilot is received"


@attack(memory_mb=300)
def flood_of_garbage(scene):
    """60 000 datagrams of noise, half frames and broken checksums, as fast as they go."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        chance, rival = random.Random(1), aircraft.endpoint()
        whole, since = rival.datagram(heartbeat()), time.monotonic()
        for number in range(60_000):
            data = chance.randbytes(chance.randrange(1, 300)) if number % 3 else b"\xfd\xff" + whole[2:] + chance.randbytes(9)
            rival.socket.setblocking(True)
            rival.socket.sendto(data, rival.address)
        scene.attacked(scene.wait_for(lambda: aircraft.link().get("rejected_by"), 5), "nothing arrived")
        aircraft.flies_on(since)
        return f"flies on, GPS_INPUT at most {aircraft.autopilot.longest_gap_s('GPS_INPUT', since):.2f} s apart"


@attack(memory_mb=300)
def five_thousand_signed_streams(scene):
    """Somebody with the key signs as 5000 systems, components and link ids, to fill the table of streams."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        since = time.monotonic()
        first = aircraft.endpoint(system=255, component=190, key=KEY)
        first.send(hint())
        scene.attacked(scene.wait_for(lambda: any("255/190" in text for text in aircraft.texts()), 5), "its key is not the link's")
        rival = aircraft.endpoint(key=KEY)
        for number in range(5000):
            rival.mav.srcSystem, rival.mav.srcComponent = 2 + number % 250, 1 + number // 250
            rival.mav.signing.link_id = number % 7
            rival.send(heartbeat())
            if number % 50 == 0:
                time.sleep(0.01)
        late = aircraft.endpoint(system=254, component=254, key=KEY, link_id=8)
        late.send(hint())
        time.sleep(1)
        aircraft.flies_on(since)
        scene.holds(aircraft.link()["connected"], "the autopilot is not received any more")
        taken = any("254/254" in text for text in aircraft.texts())
        scene.holds(not taken, "the 5001st stream is received as well: the table has no end")
        return "no stream beyond the table's end is received; the autopilot is"


@attack()
def new_key_over_the_air(scene):
    """SETUP_SIGNING with a key of the attacker's own, unsigned, and then frames that are signed with it."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        rival, own = aircraft.endpoint(), bytes(range(32))
        rival.send(dialect.MAVLink_setup_signing_message(1, 197, own, signing_time()))
        time.sleep(0.3)
        before = aircraft.rejected()
        signer = aircraft.endpoint(system=255, component=190, key=own)
        for _ in range(20):
            signer.send(heartbeat(), hint())
        scene.attacked(scene.wait_for(lambda: aircraft.rejected() >= before + 20, 5), f"nothing arrived: {aircraft.link()}")
        scene.holds(not any("255/190" in text for text in aircraft.texts()), "the hint was taken")
        aircraft.flies_on(time.monotonic() - 1)
        return f"{aircraft.rejected()} frames refused"


@attack()
def bits_flipped_in_signed_frames(scene):
    """Somebody in the middle flips one bit of each signed frame, and corrects the checksum."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        relay, chance = aircraft.endpoint(), random.Random(2)
        source = LinkEndpoint(aircraft.link_port, key=KEY)
        begun, sent = time.monotonic(), 0
        aircraft.autopilot.mute = True
        for _ in range(100):
            for message in telemetry(begun):
                data = bytearray(source.datagram(message))
                data[10 + chance.randrange(data[1])] ^= 1 << chance.randrange(8)
                number = int.from_bytes(data[7:10], "little")
                crc = dialect.x25crc(bytes(data[1:10 + data[1]]))
                crc.accumulate(bytes([dialect.mavlink_map[number].crc_extra]))
                data[10 + data[1]:12 + data[1]] = crc.crc.to_bytes(2, "little")
                relay.send_bytes(bytes(data))
                sent += 1
        source.close()
        wrong = scene.wait_for(lambda: aircraft.link().get("rejected_by", {}).get("wrong_signature"), 5)
        scene.attacked(aircraft.rejected() >= sent // 2, f"they did not arrive: {aircraft.link()}")
        scene.holds(relay.count("GPS_INPUT") == 0, "the relay is sent the fixes")
        return f"{aircraft.rejected()} of {sent} refused ({wrong} with a wrong signature)"


@attack()
def telemetry_that_is_no_number(scene):
    """The autopilot itself sends NaN, infinities, the poles and a clock that runs backwards."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        since, nan, inf = time.monotonic(), float("nan"), float("inf")
        rival = aircraft.endpoint(key=KEY, link_id=3)
        for number in range(300):
            value = (nan, inf, -inf, 1e38)[number % 4]
            rival.send(dialect.MAVLink_attitude_message(number, value, value, value, value, value, value),
                       dialect.MAVLink_global_position_int_message((1 << 32) - 1 - number, 900000000, -1800000000, -2147483648, 2147483647,
                                                                   -32768, 32767, -32768, 65535),
                       dialect.MAVLink_system_time_message((1 << 64) - 1 - number, 0),
                       dialect.MAVLink_raw_imu_message(number, 32767, -32768, 0, 0, 0, 0, 0, 0, 0),
                       dialect.MAVLink_terrain_report_message(0, 0, 0, value, value, 0, 0),
                       dialect.MAVLink_ekf_status_report_message(65535, value, value, value, value, value))
        time.sleep(1.5)
        scene.attacked(aircraft.link()["connected"], f"not connected: {aircraft.link()}")
        aircraft.flies_on(since)
        bad = [message for _, message in aircraft.autopilot.received if message.get_type() == "GPS_INPUT"
               and message.fix_type >= 3 and not abs(message.lat / 1e7 - 47.4) < 0.1]
        scene.holds(not bad, f"a fix at {bad and bad[0].lat}")
        return "flies on; no fix from it"


@attack()
def hints_that_are_nowhere(scene):
    """Position hints at NaN, at latitude 214°, with a radius below zero and of a million kilometres."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        station = aircraft.endpoint(system=255, component=190, key=KEY)
        for how in ({"lat": 214.0}, {"lon": -214.0}, {"radius_m": -5.0}, {"radius_m": float("nan")}, {"radius_m": float("inf")},
                    {"radius_m": 1e12}):
            station.send(hint(**how))
        def answers():
            return [message.result for _, message in [*station.read(), *aircraft.autopilot.received]
                    if message.get_type() == "COMMAND_ACK"]
        scene.attacked(scene.wait_for(lambda: len(answers()) >= 5, 5), f"no answers: {answers()}")
        aircraft.flies_on(time.monotonic() - 0.5)
        taken = [text for text in aircraft.texts() if "255/190" in text]
        scene.holds(len(taken) <= 1, f"taken: {taken}")  # a radius that is only too large may be clamped
        return f"answers {answers()}; {len(taken)} taken"


@attack()
def autopilot_on_the_ground_stations_link(scene):
    """Somebody on the ground station's network plays the autopilot there."""
    port = free_port(socket.SOCK_DGRAM)
    with Aircraft(scene, "--ground-station", f"udpin:127.0.0.1:{port}", signed=False) as aircraft:
        aircraft.has_package()
        rival = LinkEndpoint(port)
        begun = time.monotonic()
        while time.monotonic() - begun < 2.5:
            rival.send(heartbeat(armed=True), *telemetry(begun, lat=FAR))
            time.sleep(0.05)
        received = rival.count("HEARTBEAT")
        fixes = rival.count("GPS_INPUT")
        rival.close()
        scene.attacked(received > 0, "the ground station's link gives nothing back")
        scene.holds(not aircraft.link()["connected"], "it counts as the autopilot")
        scene.holds(fixes == 0, f"it is given {fixes} fixes")
        return f"not connected; it receives {received} heartbeats and no fix"


@attack()
def commands_to_a_logger(scene):
    """A logger's address, which is only ever sent to, sends position hints."""
    port = free_port(socket.SOCK_DGRAM)
    with Aircraft(scene, "--logger", f"udpin:127.0.0.1:{port}", signed=False, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        logger = LinkEndpoint(port, system=255, component=190)
        for _ in range(30):
            logger.send(heartbeat(), hint())
            time.sleep(0.03)
        fixes = scene.wait_for(lambda: logger.count("GPS_INPUT"), 5)
        logger.close()
        scene.attacked(fixes, "the logger is not served")
        scene.holds(not any("255/190" in text for text in aircraft.texts()), "its hint was taken")
        return "served, its commands are not taken"


@attack(memory_mb=300)
def stream_that_never_ends_a_frame(scene):
    """A TCP endpoint sends 30 MB of frame beginnings that claim 255 bytes and never end rightly."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        sent = [0]

        def pour():
            peer, _ = server.accept()
            with peer:
                try:
                    while sent[0] < 30_000_000:
                        sent[0] += peer.send(b"\xfd\xff\x00\x00\xfd\xff" * 4000)
                except OSError:
                    pass
        thread = threading.Thread(target=pour, daemon=True)
        thread.start()
        with Aircraft(scene, link=f"tcp:127.0.0.1:{server.getsockname()[1]}") as aircraft:
            aircraft.has_package()
            since = time.monotonic()
            scene.attacked(scene.wait_for(lambda: sent[0] > 5_000_000, 10), f"{sent[0]} bytes were read")
            aircraft.flies_on(since)
            return f"{sent[0] / 1e6:.0f} MB read, flies on"


@attack()
def key_file_that_others_read(scene):
    """The link's key lies with mode 0644, for any local user to copy."""
    key = scene.folder / "link.key"
    key.write_text("5a" * 32 + "\n")
    key.chmod(0o644)
    shared = scene.shared
    ran = scene.run("nadird", "--package", shared.built(), "--trust", shared.root, "--airframe", shared.airframe(scene.folder),
                    "--state", scene.folder / "state", "--camera", f"folder:{scene.folder}", "--autopilot",
                    f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}", "--signing-key", key, limit_s=8)
    scene.attacked(os.stat(key).st_mode & 0o044, "it is not readable")
    return scene.rejected(ran, "0600", "link.key", code=2)
