"""What a candidate service remembers and does, in few words: the tests' own other end of the contract
(schemas/candidates.openapi.yaml). It reads packs by itself and counts what it accepts, so that a tile that is lost or
counted twice shows. It checks no signatures: nadir-candidates does.
"""
import collections
import hashlib
import json
import struct
import threading

MAX_PACK = 8 << 20


class Problem(Exception):
    def __init__(self, status, kind, detail, headers=None, **more):
        super().__init__(detail)
        self.status, self.kind, self.detail, self.headers, self.more = status, kind, detail, headers or {}, more


def canonical(document):
    return json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()


def read_pack(data):
    """Digest to bytes, by the words of the contract alone."""
    if data[:8] != b"NADIRPK1":
        raise ValueError("magic")
    (count,) = struct.unpack_from(">I", data, 8)
    at, tiles = 12 + 36 * count, {}
    for i in range(count):
        digest, size = struct.unpack_from(">32sI", data, 12 + 36 * i)
        tile = data[at:at + size]
        at += size
        if len(tile) != size or hashlib.sha256(tile).digest() != digest or digest.hex() in tiles:
            raise ValueError(f"tile {i}")
        tiles[digest.hex()] = bytes(tile)
    if at != len(data):
        raise ValueError("length")
    return tiles


class Service:
    """What a service remembers, and the calls of the contract on it."""

    def __init__(self, part_max=MAX_PACK, keep_partial=False, at_once=False, judge=None, refuse=None):
        self.lock = threading.RLock()
        self.part_max, self.keep_partial = part_max, keep_partial
        self.at_once = at_once  # all verdicts with the first question
        self.judge = judge or (lambda sidecar: None)    # a reason code, or None
        self.refuse = refuse or (lambda sidecar: None)
        self.uploads, self.by_key, self.packs, self.blobs = {}, {}, {}, {}
        self.accepted = collections.Counter()  # by the sidecar's digest: how often it counted
        self.rejected = collections.Counter()
        self.received = 0  # bytes from sockets
        self.requests = collections.Counter()
        self.packs_taken = self.opened = 0

    def announce(self, key, body):
        document = json.loads(body)
        batch = document["signed"]
        if set(document) != {"signed", "signatures"} or batch["schema"] != "nadir.batch/1":
            raise Problem(422, "batch-invalid", "not a batch")
        if key != batch["batch"]:
            raise Problem(422, "batch-invalid", "the Idempotency-Key is not the batch's id")
        digest = hashlib.sha256(body).hexdigest()
        if key in self.by_key:
            upload = self.uploads[self.by_key[key]]
            if upload["body"] != digest:
                raise Problem(422, "key-reused", "this key belongs to another body")
            return 200, self.announcement(upload)
        tiles = {}
        for tile in batch["tiles"]:
            sidecar = tile["sidecar"]
            code = self.refuse(sidecar)
            tiles[sidecar["sha256"]] = {"sidecar": sidecar, "name": hashlib.sha256(canonical(sidecar)).hexdigest(),
                                        "verdict": "rejected" if code else "pending", "code": code, "refused": bool(code)}
        if len(tiles) != len(batch["tiles"]) or len(tiles) > 2000 or len(body) > 4 << 20:
            raise Problem(422, "batch-invalid", "a tile twice, or too many")
        self.opened += 1
        upload = {"id": f"upload-{self.opened:06d}", "key": key, "body": digest, "tiles": tiles, "state": "open",
                  "polls": 0}
        self.uploads[upload["id"]] = upload
        self.by_key[key] = upload["id"]
        return 201, self.announcement(upload)

    def announcement(self, upload):
        wanted = [sha for sha, tile in upload["tiles"].items() if not tile["refused"]]
        return {"upload_id": upload["id"], "missing": [s for s in wanted if s not in self.blobs],
                "known": [s for s in wanted if s in self.blobs],
                "refused": [{"sha256": s, "code": t["code"], "detail": "as the test wants"}
                            for s, t in upload["tiles"].items() if t["refused"]],
                "part_max": self.part_max, "expires_at": "2099-01-01T00:00:00Z"}

    def upload(self, upload_id):
        if upload_id not in self.uploads:
            raise Problem(404, "not-found", "no such upload")
        return self.uploads[upload_id]

    def offset(self, upload_id, sha):
        self.upload(upload_id)
        pack = self.packs.get((upload_id, sha))
        if pack is None:
            raise Problem(404, "pack-unknown", "no byte of this pack")
        return pack["length"] if pack["done"] else len(pack["data"]), pack["length"]

    def part(self, upload_id, sha, offset, length, digest, body, whole=True):
        upload = self.upload(upload_id)
        pack = self.packs.setdefault((upload_id, sha), {"data": bytearray(), "length": length, "done": False})
        reached = pack["length"] if pack["done"] else len(pack["data"])
        if offset != reached:
            raise Problem(409, "offset-mismatch", f"the pack continues at byte {reached}", {"Upload-Offset": str(reached)})
        if not whole:
            if self.keep_partial:
                pack["data"] += body
            return len(pack["data"])
        if length != pack["length"] or offset + len(body) > length or length > MAX_PACK:
            raise Problem(422, "pack-invalid", "lengths that do not fit")
        if digest != hashlib.sha256(body).digest():
            raise Problem(460, "digest-mismatch", "the part's SHA-256 does not match")
        pack["data"] += body
        if len(pack["data"]) < length:
            return len(pack["data"])
        data = bytes(pack["data"])
        try:
            if hashlib.sha256(data).hexdigest() != sha:
                raise ValueError("digest")
            tiles = read_pack(data)
            for digest_of, tile in tiles.items():
                if len(tile) != upload["tiles"][digest_of]["sidecar"]["size"]:
                    raise ValueError("size")
        except (ValueError, KeyError, struct.error) as error:
            del self.packs[(upload_id, sha)]
            raise Problem(422, "pack-invalid", f"not a pack of this upload: {error}")
        self.blobs.update(tiles)
        pack.update(done=True, data=bytearray())
        self.packs_taken += 1
        return length

    def complete(self, upload_id):
        upload = self.upload(upload_id)
        missing = [s for s, t in upload["tiles"].items() if not t["refused"] and s not in self.blobs]
        if missing:
            raise Problem(409, "incomplete", f"{len(missing)} tiles are missing", missing=missing)
        if upload["state"] == "open":
            upload["state"] = "judging"
        return {"upload_id": upload_id, "pending": sum(t["verdict"] == "pending" for t in upload["tiles"].values())}

    def status(self, upload_id):
        upload = self.upload(upload_id)
        if upload["state"] == "judging":
            upload["polls"] += 1
            pending = [t for t in upload["tiles"].values() if t["verdict"] == "pending"]
            half = upload["polls"] == 1 and not self.at_once
            for tile in pending[:len(pending) // 2] if half else pending:
                self.decide(tile)
            if not half:
                upload["state"] = "judged"
        return {"upload_id": upload_id, "batch": upload["key"], "state": upload["state"], "expires_at": "2099-01-01T00:00:00Z",
                "tiles": [{"sha256": s, "verdict": t["verdict"], "code": t["code"], "detail": "", "retryable": False}
                          for s, t in upload["tiles"].items()]}

    def decide(self, tile):
        code = self.judge(tile["sidecar"])
        if code:
            tile.update(verdict="rejected", code=code)
            self.rejected[tile["name"]] += 1
        elif self.accepted[tile["name"]]:
            tile["verdict"] = "duplicate"
        else:
            tile["verdict"] = "accepted"
            self.accepted[tile["name"]] += 1

    def forget(self, upload_id):
        upload = self.uploads.pop(upload_id, None)
        if upload:
            del self.by_key[upload["key"]]
