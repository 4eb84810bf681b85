"""Signs an airframe's file as `nadir provision` does, without an autopilot to provision: a DSSE envelope beside it
(docs/trust.md), by the key to which the root gives the role. openssl signs."""
import base64
import json
import subprocess
import tempfile

PAYLOAD_TYPE = b"application/vnd.nadir.airframe.v1+json"


def airframe_signer(root):
    """The id of the root's airframe signer; None where the root has no such role."""
    role = json.loads(root.read_text(encoding="utf-8"))["signed"]["roles"].get("airframe-signer")
    return role["keyids"][0] if role else None


def sign_airframe(airframe, key, root):
    """Writes airframe.json.sig. key: the private key's file."""
    body = airframe.read_bytes()
    with tempfile.NamedTemporaryFile() as message:
        message.write(b"DSSEv1 %d %s %d %s" % (len(PAYLOAD_TYPE), PAYLOAD_TYPE, len(body), body))
        message.flush()
        signed = subprocess.run(["openssl", "pkeyutl", "-sign", "-rawin", "-inkey", key, "-in", message.name],
                                stdin=subprocess.DEVNULL, capture_output=True, check=True)
    signature = {"keyid": airframe_signer(root), "sig": base64.b64encode(signed.stdout).decode()}
    beside = airframe.with_name(airframe.name + ".sig")
    beside.write_text(json.dumps({"payloadType": PAYLOAD_TYPE.decode(), "signatures": [signature]}) + "\n",
                      encoding="utf-8")
