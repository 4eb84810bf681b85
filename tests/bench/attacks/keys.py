"""Who has an account on the computer where keys are made or files are kept, or holds an old key or file."""
import base64
import json
import os
import re
import stat
import subprocess
import threading

from .registry import Measured, attack
from .shared import TESTS, day, key_id, sign

ROOT_TYPE = "application/vnd.nadir.root.v1+json"


@attack("M10")
def link_planted_under_a_predictable_name(scene):
    """Links to a victim's file are planted under every name .tmpPID that `keys create` could use, for the next 4000 processes."""
    victim = scene.folder / "victim"
    victim.write_text("precious")
    out = scene.folder / "out"
    out.mkdir()
    begin = int(subprocess.run(["sh", "-c", "echo $$"], capture_output=True, text=True, check=True).stdout)
    for pid in range(begin, begin + 4000):
        for name in ("k.key.pem", "k.pub.pem"):
            (out / f"{name}.tmp{pid}").symlink_to(victim)
    ran = scene.run("nadir", "keys", "create", "--out", out / "k")
    scene.attacked(len(list(out.iterdir())) >= 8000, "the links are not there")
    scene.holds(victim.read_text() == "precious", "the victim's file was written to, with the key in it")
    scene.holds(ran.code == 0 and not (out / "k.key.pem").is_symlink(), f"no key: {ran.said[:100]}")
    scene.holds(stat.S_IMODE((out / "k.key.pem").stat().st_mode) == 0o600, "others may read the key")
    return "created, 0600; the victim's file is untouched"


@attack("M10")
def key_read_before_its_mode_is_set(scene):
    """With the umask 0 somebody opens every new file of the folder at once, to hold the key open before it is closed to him."""
    seen, stopped = [], threading.Event()
    out = scene.folder / "out"
    out.mkdir(mode=0o777)

    def look():
        while not stopped.is_set():
            for entry in os.scandir(out):
                try:
                    info = entry.stat(follow_symlinks=False)
                except OSError:
                    continue
                if ".pub." not in entry.name and "key" in entry.name and info.st_mode & 0o077:
                    seen.append((entry.name, oct(info.st_mode), info.st_size))
    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        for number in range(25):
            ran = scene.run("nadir", "keys", "create", "--out", out / f"k{number}", umask=0)
            scene.attacked(ran.code == 0, ran.said[:100])
    finally:
        stopped.set()
        thread.join()
    modes = {stat.S_IMODE(path.stat().st_mode) for path in out.glob("*.key.pem")}
    scene.holds(not seen, f"readable for a moment: {seen[0] if seen else ''}")
    scene.holds(modes == {0o600}, f"modes {modes}")
    return "25 keys, never readable by others"


@attack("L8")
def eight_processes_create_one_key(scene):
    """Eight processes create the same key pair at once, six times over."""
    for turn in range(6):
        name = scene.folder / f"k{turn}"
        started = [Measured([scene.program("nadir"), "keys", "create", "--out", name], scene.folder) for _ in range(8)]
        ran = [one.finish(20) for one in started]
        scene.peak_mb = max([scene.peak_mb, *(one.peak_mb for one in ran)])
        created = sum(one.code == 0 for one in ran)
        scene.attacked(len(ran) == 8, "not eight")
        scene.holds(created == 1, f"{created} of 8 processes say that they created it")
        derived = subprocess.run(["openssl", "pkey", "-in", f"{name}.key.pem", "-pubout"], capture_output=True, text=True, check=True).stdout
        scene.holds(derived == name.with_name(name.name + ".pub.pem").read_text(), "the public key belongs to another private key")
        scene.code = max(one.code for one in ran)
    left = [path.name for path in scene.folder.iterdir() if path.name.startswith(".k") or ".tmp" in path.name]
    scene.holds(not left, f"left behind: {left}")
    return "one of eight, six times; both halves fit"


@attack("M10")
def report_over_a_planted_link(scene):
    """In a shared folder a link to a victim's file waits where a result is to be written."""
    victim = scene.folder / "victim"
    victim.write_text("precious")
    keys = scene.shared.keys
    (scene.folder / "root.json").symlink_to(victim)
    ran = scene.run("nadir", "keys", "root", "--root-key", keys / "root.key.pem", "--package-signer", keys / "signer.pub.pem", "--expires",
                    day(900)[:10], "--out", scene.folder / "root.json")
    scene.attacked(ran.code in (0, 2), ran.said[:100])
    scene.holds(victim.read_text() == "precious", "the victim's file was written to")
    return f"exit code {ran.code}, the victim's file is untouched"


def check_airframe(scene, airframe, state, *more):
    return scene.run("nadird", "--package", scene.shared.built(), "--trust", scene.shared.root, "--airframe", airframe, "--state", state, "--check", *more)


def numbered(scene, name, sequence, expires=400, key=None, **changes):
    folder = scene.folder / name
    folder.mkdir()
    return scene.shared.airframe(folder, key, sequence=sequence, expires=day(expires), **changes)


@attack("M12")
def older_airframe_file_put_back(scene):
    """The airframe's file of last year, with the old camera and the old addresses, still signed."""
    state = scene.folder / "state.json"
    newer, older = numbered(scene, "newer", 3), numbered(scene, "older", 2, capture_delay_s=0.9)
    first = check_airframe(scene, newer, state)
    scene.attacked(first.code == 0, f"the newer one is not accepted: {first.said[:150]}")
    ran = check_airframe(scene, older, state)
    scene.rejected(ran, "airframe.rollback")
    undated = scene.shared.airframe(scene.folder)
    scene.rejected(check_airframe(scene, undated, state), "airframe.rollback")
    return "airframe.rollback, also without a number"


@attack("M12")
def expired_airframe_file(scene):
    """An airframe's file whose date has passed."""
    ran = check_airframe(scene, numbered(scene, "old", 3, expires=-1), scene.folder / "state.json")
    return scene.rejected(ran, "airframe.expired")


@attack()
def airframe_file_of_an_unknown_signer(scene):
    """airframe.json edited, signed by an unknown key, signed by the package signer, and without a signature."""
    answers = []
    for number, key in enumerate(("untrusted", "signer", None, "edited")):
        path = numbered(scene, f"a{number}", 1, key=scene.shared.keys / f"{key if key in ('untrusted', 'signer') else 'hangar'}.key.pem")
        if key is None:
            path.with_name("airframe.json.sig").unlink()
        elif key == "edited":
            path.write_text(path.read_text().replace("250.0", "150.0"))
        ran = check_airframe(scene, path, scene.folder / "state.json")
        answers.append(scene.rejected(ran, "airframe.unsigned", "signature.invalid", "key.unknown", "signature.missing"))
    return ", ".join(answers)


@attack("L2")
def expired_root_key_appoints(scene):
    """Somebody finds a root key whose own date has passed, and appoints himself with a next root."""
    keys = scene.shared.keys
    root = json.loads(scene.shared.root.read_text())["signed"]
    old = key_id(keys / "root.key.pem")
    root["keys"][old]["expires"] = day(-30)

    def signed(document):
        return json.dumps({"signed": document, "signatures": [{"keyid": old, "sig": sign(
            keys / "root.key.pem", ROOT_TYPE, json.dumps(document, sort_keys=True, separators=(",", ":")).encode())}]})
    installed = scene.folder / "root.json"
    installed.write_text(signed(root))
    package = scene.shared.package(scene.folder)
    trusted = scene.run("nadir", "cache", "verify", package, "--trust", installed)
    scene.attacked(trusted.code == 0, f"the installed root is not accepted: {trusted.said[:150]}")
    thief, public = keys / "untrusted.key.pem", keys / "untrusted.pub.pem"
    der = subprocess.run(["openssl", "pkey", "-in", thief, "-pubout", "-outform", "DER"], capture_output=True, check=True).stdout
    second = json.loads(json.dumps(root))
    second["version"] = 2
    second["keys"][key_id(thief)] = {"algorithm": "ed25519", "public": base64.b64encode(der[-32:]).decode()}
    second["roles"]["package-signer"]["keyids"] = [key_id(thief)]
    forged = scene.shared.package(scene.folder, "forged", key=thief)
    (forged / "root").mkdir()
    (forged / "root" / "2.root.json").write_text(signed(second))
    ran = scene.run("nadir", "cache", "verify", forged, "--trust", installed)
    scene.attacked(public.exists() and "2.root.json" in ran.said or "key." in ran.said or ran.code == 0, ran.said[:150])
    scene.rejected(ran, "key.expired")
    return "key.expired: it appoints nobody"


@attack()
def revoked_key_signs_on(scene):
    """The next root revokes a package signer, whose packages are still there."""
    keys = scene.shared.keys
    package = scene.shared.package(scene.folder)
    made = scene.run("nadir", "keys", "root", "--root-key", keys / "root.key.pem", "--package-signer", keys / "signer.pub.pem", "--package-signer",
                     keys / "untrusted.pub.pem", "--expires", day(900)[:10], "--out", scene.folder / "1.json")
    scene.attacked(made.code == 0, made.said[:200])
    made = scene.run("nadir", "keys", "revoke", "--previous", scene.folder / "1.json", "--revoke", key_id(keys / "signer.key.pem"), "--root-key",
                     keys / "root.key.pem", "--out", scene.folder / "2.json")
    scene.attacked(made.code == 0, made.said[:200])
    before = scene.run("nadir", "cache", "verify", package, "--trust", scene.folder / "1.json")
    scene.attacked(before.code == 0, before.said[:200])
    ran = scene.run("nadir", "cache", "verify", package, "--trust", scene.folder / "2.json")
    return scene.rejected(ran, "key.revoked")


@attack()
def private_key_that_others_may_read(scene):
    """A signing key with mode 0644; a public key in place of a private one; a pipe as a key."""
    keys, answers = scene.shared.keys, []
    loose = scene.folder / "loose.key.pem"
    loose.write_bytes((keys / "signer.key.pem").read_bytes())
    loose.chmod(0o644)
    os.mkfifo(scene.folder / "pipe.key.pem", 0o600)
    package = scene.shared.package(scene.folder)
    for key in (loose, keys / "signer.pub.pem", scene.folder / "pipe.key.pem"):
        ran = scene.run("nadir", "cache", "sign", package, "--key", key, limit_s=8)
        answers.append(scene.rejected(ran, key.name, code=2))
    return f"refused: {', '.join(answers)}"


@attack()
def state_torn_and_edited(scene):
    """aircraft.json is cut off, emptied and edited, so that an old package is accepted again."""
    state = scene.folder / "state.json"
    check = lambda package: scene.run("nadird", "--package", package, "--trust", scene.shared.root, "--airframe", "mini-07", "--state", state, "--check")
    newer, older = scene.shared.built(sequence=2), scene.shared.built()
    scene.attacked(check(newer).code == 0, "the newer one is not accepted")
    whole, answers = state.read_bytes(), []
    for torn in (whole[:len(whole) // 2], b"", b"{}", b"[]", whole.replace(b"2", b"0", 1), b"\0" * len(whole)):
        state.write_bytes(torn)
        ran = check(older)
        answers.append(scene.rejected(ran, "state.corrupt", "package.rollback", "time.untrusted"))
        scene.holds(state.read_bytes() == torn, "the damaged memory was overwritten")
    return ", ".join(dict.fromkeys(answers))


@attack()
def permit_edited_and_foreign(scene):
    """A permit to go back is edited for another aircraft, and one is signed by an unknown key."""
    keys, state, answers = scene.shared.keys, scene.folder / "state.json", []
    check = lambda package, *more: scene.run("nadird", "--package", package, "--trust", scene.shared.root, "--airframe", "mini-07", "--state", state,
                                             "--check", *more)
    older = scene.shared.built()
    scene.attacked(check(scene.shared.built(sequence=2)).code == 0, "the newer one is not accepted")
    for number, (key, airframe) in enumerate((("signer", "mini-08"), ("untrusted", "mini-07"), ("signer", "mini-07"))):
        permit = scene.folder / f"permit{number}.json"
        made = scene.run("nadir", "keys", "permit-rollback", "--key", keys / f"{key}.key.pem", "--series", "small", "--from", "2", "--to", "1",
                         "--airframe", airframe, "--expires", day(30)[:10], "--out", permit)
        scene.attacked(made.code == 0, made.said[:200])
        if number == 2:
            permit.write_text(permit.read_text().replace('"to": 1', '"to": 0').replace('"from": 2', '"from": 9'))
        answers.append(scene.rejected(check(older, "--permit", permit), "permit.invalid", "package.rollback", "signature", "key.unknown"))
    return ", ".join(answers)


@attack("M7")
def password_of_the_catalogue(scene):
    """The catalogue's PostgreSQL password, given in the connection string, is looked for in messages."""
    ran = scene.run("nadir", "catalogue", "list", "PG:host=127.0.0.1 port=1 user=fleet password=Pa55word dbname=x")
    again = scene.run("nadir", "catalogue", "list", "postgresql://fleet:Pa55word@127.0.0.1:1/x")
    scene.attacked(ran.code == 2 and again.code == 2 and ran.said.strip(), f"{ran.said[:100]}")
    scene.holds("Pa55word" not in ran.said + again.said, f"it is in the message: {(ran.said + again.said)[:150]}")
    return ran.said.strip().splitlines()[0][:100]


@attack("L11")
def unit_of_the_service(scene):
    """The systemd unit is asked what a captured nadird could reach."""
    unit = (TESTS.parent / "runtime" / "nadird.service").read_text()
    wanted = {"NoNewPrivileges": "yes|true", "ProtectSystem": "strict", "CapabilityBoundingSet": "", "IPAddressDeny": "any", "LoadCredential": ".+",
              "ReadWritePaths": ".+", "MemoryDenyWriteExecute": "yes|true", "RestartPreventExitStatus": "2"}
    missing = [name for name, value in wanted.items() if not re.search(rf"^{name}=({value})\s*$" if value else rf"^{name}=", unit, re.M)]
    scene.attacked("[Service]" in unit, "no unit")
    scene.holds(not missing, f"missing: {', '.join(missing)}")
    return ", ".join(wanted)
