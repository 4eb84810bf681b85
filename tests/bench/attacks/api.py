"""Who has an account on the companion computer, or a web page open in a browser there, and speaks to nadird's API."""
import http.client
import http.server
import json
import socket
import threading
import time

from .aircraft import LAT, LON, Aircraft, heartbeat, hint, plain_request, sse_reader
from .registry import attack
from .shared import TOKEN, free_port
from .watching import Listener

HINT = json.dumps({"lat": LAT, "lon": LON, "radius_m": 300}).encode()


def ask(aircraft, method, path, body=None, **headers):
    """Status and body."""
    connection = http.client.HTTPConnection("127.0.0.1", aircraft.api_port, timeout=10)
    try:
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def post_hint(aircraft, token=None, **headers):
    more = {"Authorization": f"Bearer {token}"} if token else {}
    return ask(aircraft, "POST", "/v1/hint", HINT, **{"Content-Type": "application/json", **more, **headers})


def hints(aircraft):
    return [text for text in aircraft.texts() if "hint" in text.lower() or "operator" in text.lower()]


def own_token(scene, aircraft):
    """The token that the service has made for those who may write."""
    path = aircraft.state_folder / "api-token"
    scene.wait_for(path.exists, 5, "there is no api-token in the state folder")
    scene.holds(path.stat().st_mode & 0o077 == 0, f"others may read api-token: {oct(path.stat().st_mode)}")
    return path.read_text().strip()


@attack("M9")
def hint_by_any_local_user(scene):
    """A local user without the token moves the search with a position hint."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        status, body = post_hint(aircraft)
        scene.holds(status == 401, f"taken without a token: {status}")
        wrong, _ = post_hint(aircraft, "0" * 32)
        scene.holds(wrong == 401, f"taken with a wrong token: {wrong}")
        right, _ = post_hint(aircraft, own_token(scene, aircraft))
        scene.attacked(right in (200, 202, 204), f"the request is not sound: {right} with the token")
        return f"{status} without a token, {wrong} with a wrong one, {right} with the right one"


@attack("M9")
def thousand_hints(scene):
    """A thousand hints with the right token, each of which cancels a search."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        token, since = own_token(scene, aircraft), time.monotonic()
        answers = [post_hint(aircraft, token)[0] for _ in range(1000)]
        taken, seconds = sum(status < 300 for status in answers), time.monotonic() - since
        scene.attacked(taken >= 1, f"none was taken: {set(answers)}")
        scene.holds(429 in answers, f"{taken} of 1000 were taken within {seconds:.1f} s")
        scene.holds(taken <= 5 + seconds, f"{taken} were taken within {seconds:.1f} s")
        aircraft.flies_on(since)
        return f"{taken} taken in {seconds:.1f} s, then 429"


@attack("M9")
def alarm_scrolled_out(scene):
    """A critical alarm is buried under some thousand ordinary events."""
    with Aircraft(scene, signed=False, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        rival = aircraft.endpoint()
        critical = lambda events: [event for event in events if event["severity"] == "critical" and "another sender" in event["text"]]

        def raised():
            rival.send(heartbeat())
            return critical((aircraft.get() or {}).get("events", []))
        scene.attacked(scene.wait_for(raised, 15), f"there is no alarm to bury: {aircraft.texts()[-3:]}")
        station, before = aircraft.endpoint(system=255, component=190), len(aircraft.texts())
        for number in range(600):
            station.mav.srcComponent = 1 + number % 200
            station.send(hint(lat=LAT + number * 1e-5, radius_m=50.0 + number))
            if number % 20 == 0:
                time.sleep(0.05)
        scene.attacked(scene.wait_for(lambda: len(aircraft.texts()) > before, 5), "no event came after it")
        state = aircraft.get()
        scene.holds("alarms" in state, f"there is no list of alarms; it is {'still' if critical(state['events']) else 'not'} among the events")
        scene.holds(critical(state["alarms"]), "the alarm is gone")
        return f"still there: {critical(state['alarms'])[0]['text'][:70]}"


@attack("M8")
def idle_connections(scene):
    """400 connections that are opened and never send anything."""
    with Aircraft(scene) as aircraft:
        aircraft.has_package()
        idle = []
        try:
            for _ in range(400):
                end = socket.socket()
                end.settimeout(2)
                end.connect(("127.0.0.1", aircraft.api_port))
                idle.append(end)
            time.sleep(0.3)
            scene.attacked(len(idle) == 400, "not connected")
            begun, answered = time.monotonic(), 0
            for _ in range(10):
                answered += aircraft.get() is not None
            seconds = time.monotonic() - begun
            scene.holds(answered == 10, f"{answered} of 10 requests were answered beside them")
            scene.holds(seconds < 5, f"10 requests took {seconds:.1f} s")
            return f"10 of 10 requests answered in {seconds:.2f} s"
        finally:
            for end in idle:
                end.close()


@attack(seconds=40)
def headers_a_byte_at_a_time(scene):
    """200 connections that send their header one byte every half second (slow loris)."""
    with Aircraft(scene) as aircraft:
        aircraft.has_package()
        slow, closed = [], 0
        try:
            for _ in range(200):
                end = socket.socket()
                end.settimeout(2)
                end.connect(("127.0.0.1", aircraft.api_port))
                slow.append(end)
            for character in b"GET /v1/st":
                for end in slow:
                    try:
                        end.sendall(bytes([character]))
                    except OSError:
                        closed += 1
                scene.holds(aircraft.get() is not None, "no answer beside them")
                time.sleep(0.3)
            return f"answers beside them; {closed} writes to closed connections"
        finally:
            for end in slow:
                end.close()


@attack(memory_mb=100)
def streams_that_never_read(scene):
    """150 event streams whose readers never read."""
    with Aircraft(scene, autopilot=True) as aircraft:
        aircraft.has_package().connected()
        since, ends, refused = time.monotonic(), [], 0
        try:
            for _ in range(150):
                try:
                    ends.append(sse_reader(aircraft.api_port))
                except OSError:
                    refused += 1
            time.sleep(3)
            scene.attacked(len(ends) > 60, "no streams")
            aircraft.flies_on(since)
            return f"{len(ends)} opened, answers beside them"
        finally:
            for end in ends:
                end.close()


@attack("L9")
def host_that_begins_like_ours(scene):
    """DNS rebinding: requests whose Host is evil.com, [::1]evil.com, 127.0.0.1.evil.com, localhost@evil.com."""
    with Aircraft(scene) as aircraft:
        aircraft.has_package()
        answers = {}
        for host in ("evil.com", "[::1]evil.com", "127.0.0.1.evil.com", "localhost.evil.com", "localhost@evil.com", "[::1]:80.evil.com", ""):
            answers[host] = ask(aircraft, "GET", "/v1/state", Host=host)[0]
        own = ask(aircraft, "GET", "/v1/state", Host=f"[::1]:{aircraft.api_port}")[0]
        scene.attacked(own == 200, f"our own name gets {own}")
        served = [host for host, status in answers.items() if status == 200]
        scene.holds(not served, f"served as {served}")
        return ", ".join(f"{status}" for status in answers.values())


@attack()
def web_page_that_posts(scene):
    """A web page of another site sends a hint through the browser: as a form, as text, with an Origin."""
    with Aircraft(scene) as aircraft:
        aircraft.has_package()
        answers = [ask(aircraft, "POST", "/v1/hint", HINT, **{"Content-Type": kind, "Origin": "https://evil.com"})[0]
                   for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x", "application/jsonx", "")]
        preflight, headers = ask(aircraft, "OPTIONS", "/v1/hint", Origin="https://evil.com",
                                 **{"Access-Control-Request-Method": "POST"})
        scene.holds(all(status >= 400 for status in answers), f"taken: {answers}")
        scene.holds(preflight >= 400, f"the preflight is allowed: {preflight} {headers}")
        scene.holds(not hints(aircraft), "the hint was taken")
        return f"{answers}, preflight {preflight}"


@attack(memory_mb=100)
def bodies_without_end(scene):
    """A header of 1 MB, a body of 10 GB, chunks that never end, and JSON of 8000 brackets."""
    with Aircraft(scene) as aircraft:
        aircraft.has_package()
        head = b"POST /v1/hint HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        answers = []
        for request in (b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 1_000_000,
                        head + b"Content-Length: 10000000000\r\n\r\n" + b"[" * 100_000,
                        head + b"Transfer-Encoding: chunked\r\n\r\n" + b"ffffffff\r\n" + b"[" * 100_000,
                        head + b"Content-Length: 16000\r\n\r\n" + b"[" * 16_000,
                        head + b"Content-Length: -1\r\n\r\n", head + b"Content-Length: 5\r\nContent-Length: 50\r\n\r\n12345"):
            try:
                answer = plain_request(aircraft.api_port, request, 3, until=b"\r\n").split(b" ", 2)
            except OSError:
                answer = []
            answers.append(answer[1].decode() if len(answer) > 1 else "closed")
        scene.holds("200" not in answers, f"served: {answers}")
        scene.holds(aircraft.get() is not None, "it does not answer any more")
        return ", ".join(answers)


@attack()
def two_requests_in_one(scene):
    """Request smuggling: Content-Length beside Transfer-Encoding, line breaks alone, a second request in the body."""
    with Aircraft(scene) as aircraft:
        aircraft.has_package()
        inner = b"POST /v1/hint HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: %d\r\n\r\n" % len(HINT) + HINT
        answers = []
        for outer in (b"POST /v1/object-location HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n" + inner,
                      b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d\r\n\r\n" % len(inner) + inner,
                      b"GET /v1/health HTTP/1.1\nHost: localhost\nX: y\r\n\r\n", b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\nX : y\r\n\r\n"):
            answer = plain_request(aircraft.api_port, outer, 2, until=b"\r\n\r\n")
            answers.append(answer.split(b" ", 2)[1].decode() if b" " in answer else "closed")
        scene.holds(not hints(aircraft), "the hidden hint was taken")
        return ", ".join(answers)


@attack()
def paths_that_lead_out(scene):
    """Paths with .., encoded, doubled, with null bytes, and tiles at impossible addresses."""
    with Aircraft(scene) as aircraft:
        aircraft.has_package()
        answers = []
        for path in ("/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/v1/../../etc/passwd", "/page.js/../../../etc/passwd",
                     "/v1/tiles/18/../../x", "/v1/tiles/99999999999999999999/0/0", "/v1/tiles/-1/-1/-1", "/v1/tiles/18/1/1;x", "/%00"):
            status, body = ask(aircraft, "GET", path)
            scene.holds(b"root:x:0" not in body, f"{path} gives a file of the system")
            answers.append(status)
        scene.holds(200 not in answers, f"served: {answers}")
        return ", ".join(map(str, dict.fromkeys(answers)))


@attack()
def beyond_loopback_without_a_token(scene):
    """nadird is to listen on all addresses, and nobody has given it a token."""
    shared = scene.shared
    ran = scene.run("nadird", "--package", shared.built(), "--trust", shared.root, "--airframe", shared.airframe(scene.folder),
                    "--state", scene.folder / "state", "--camera", f"folder:{scene.folder}", "--autopilot",
                    f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}", "--signing-key", shared.keys / "link.key", "--listen", "0.0.0.0:0", limit_s=8)
    return scene.rejected(ran, "requires a token", code=2)


@attack()
def guessed_tokens(scene):
    """1000 guesses at a bearer token, with its beginning right, too long, in other places."""
    with Aircraft(scene, "--token-file", scene.shared.keys / "api.token") as aircraft:
        scene.wait_for(lambda: ask_quietly(aircraft), 10, "it does not answer")
        guesses = [TOKEN[:-1], TOKEN + "0", TOKEN.upper() + "x", "", " ", TOKEN[::-1], "a" * 5000]
        connection = http.client.HTTPConnection("127.0.0.1", aircraft.api_port, timeout=10)
        served, tried = [], 0
        for number in range(1000):
            guess = guesses[number % len(guesses)]
            try:
                connection.request("GET", "/v1/state", headers={"Authorization": f"Bearer {guess}"})
                answer = connection.getresponse()
                answer.read()
                if answer.status == 200:
                    served.append(guess)
            except (OSError, http.client.HTTPException):
                connection.close()
            tried += 1
        for path in (f"/v1/state?token={TOKEN}", f"/v1/state?access_token={TOKEN}"):
            if ask(aircraft, "GET", path)[0] == 200:
                served.append(path)
        scene.attacked(ask(aircraft, "GET", "/v1/state", Authorization=f"Bearer {TOKEN}")[0] == 200, "the right one is not taken")
        scene.holds(not served, f"served with {served[:2]}")
        return f"{tried} times 401; the right one is taken"


def ask_quietly(aircraft):
    try:
        return ask(aircraft, "GET", "/v1/health")[0]
    except OSError:
        return None


@attack("M7")
def password_of_the_camera(scene):
    """The RTSP password is looked for in the API, the log, the state folder and the recordings."""
    record = scene.folder / "record"
    with Listener(b"RTSP/1.0 401 Unauthorized\r\nCSeq: 1\r\nWWW-Authenticate: Basic realm=\"rtsp://pilot:Pa55word@cam\"\r\n\r\n") as listener:
        with Aircraft(scene, "--record", record, camera=f"rtsp://pilot:Pa55word@127.0.0.1:{listener.port}/stream", autopilot=True) as aircraft:
            aircraft.has_package()
            time.sleep(2.5)
            output = json.dumps([aircraft.get(path) for path in ("/v1/state", "/v1/health", "/v1/package")])
            output += ask(aircraft, "GET", "/v1/metrics")[1].decode() + aircraft.service.text()
            scene.end(aircraft.service)
    where = [str(path.relative_to(scene.folder)) for folder in (record, scene.folder / "state") for path in folder.rglob("*")
             if path.is_file() and b"Pa55word" in path.read_bytes()]
    scene.attacked(b"rtsp" in output.encode().lower() or listener.calls or "camera" in output, "the camera was never opened")
    scene.holds("Pa55word" not in output, "it is in the API or the log")
    scene.holds(not where, f"it is in {', '.join(where)}")
    return "in none of them"


@attack("M7")
def password_in_the_list_of_processes(scene):
    """The same password is looked for in /proc/PID/cmdline; the way without is a file."""
    secret = scene.folder / "camera.secret"
    secret.write_text("pilot:Pa55word\n")
    secret.chmod(0o600)
    with Listener() as listener:
        with Aircraft(scene, "--camera-credentials", secret, camera=f"rtsp://127.0.0.1:{listener.port}/stream") as aircraft:
            aircraft.has_package()
            scene.wait_for(lambda: listener.calls, 4)
            with open(f"/proc/{aircraft.service.pid}/cmdline", "rb") as file:
                words = file.read()
            scene.holds(b"Pa55word" not in words, "it is there")
            scene.holds("Pa55word" not in aircraft.service.text() + str(aircraft.get()), "it is in the API or the log")
            secret.chmod(0o644)
    return "not there"


class Hostile(http.server.BaseHTTPRequestHandler):
    """A service that is not nadird: answers every request with `answer`."""
    answer, endless = b"", False

    def do_GET(self):
        self.server.calls += 1
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.end_headers()
        try:
            self.wfile.write(self.answer)
            while self.endless:
                self.wfile.write(b" " * 1_000_000)
        except OSError:
            pass

    def log_message(self, *_):
        pass


def hostile(answer, endless=False):
    kind = type("Answering", (Hostile,), {"answer": answer, "endless": endless})
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), kind)
    server.calls, server.daemon_threads = 0, True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


@attack("L3")
def status_of_a_false_service(scene):
    """`nadird --status` asks a port where another program answers: with escape sequences, forged lines, and wrong types."""
    with Aircraft(scene) as aircraft:
        state = aircraft.has_package().get()
        genuine = scene.run("nadird", "--status", "--listen", f"127.0.0.1:{aircraft.api_port}")
    state["state"], state["reason"] = "normal\x1b[2J\nposition good", "ok\n\x1b]0;owned\x07position good\n"
    state["gps"]["judgement"] = "good\nposition good"
    answers = []
    for answer in (json.dumps(state).encode(), json.dumps({**state, "frames": "x", "link": 7}).encode(), b"[1]", b"\xff" * 100, b"{" * 100_000):
        server = hostile(answer)
        ran = scene.run("nadird", "--status", "--listen", f"127.0.0.1:{server.server_address[1]}")
        scene.attacked(server.calls, "it was not asked")
        server.shutdown(), server.server_close()
        scene.holds("\x1b" not in ran.said, "an escape sequence reaches the terminal")
        scene.holds("position good" not in [line.strip() for line in ran.said.splitlines()], "a line is forged")
        answers.append(ran.code)
    scene.attacked(genuine.said.strip(), "the genuine service prints nothing")
    return f"exit codes {answers}, no line or sequence of theirs"


@attack(memory_mb=150)
def status_without_end(scene):
    """`nadird --status` asks a port where the answer never ends."""
    server = hostile(b"{", endless=True)
    ran = scene.run("nadird", "--status", "--listen", f"127.0.0.1:{server.server_address[1]}", limit_s=20)
    scene.attacked(server.calls, "it was not asked")
    server.shutdown(), server.server_close()
    return scene.rejected(ran, code=2) and ran.said.strip()[:90]
