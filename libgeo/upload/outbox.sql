-- The outbox (docs/formats/outbox.md). The tables guard themselves: whatever program changes them, a tile goes only the
-- ways that stand in `step`, and its bytes go only after a final verdict.
CREATE TABLE batch (
  id INTEGER PRIMARY KEY,
  uuid TEXT NOT NULL UNIQUE,
  airframe TEXT NOT NULL,
  flight TEXT NOT NULL,
  stage TEXT NOT NULL CHECK (stage IN ('sealed', 'announced', 'complete', 'done', 'parked')),
  upload TEXT,                             -- the service's name for it
  part_max INTEGER,                        -- bytes
  attempts INTEGER NOT NULL DEFAULT 0,     -- since something last came forward
  not_before_ms INTEGER NOT NULL DEFAULT 0,  -- the next attempt, since 1970
  trouble TEXT NOT NULL DEFAULT '',        -- what the last attempt met
  sealed_ms INTEGER NOT NULL
);
-- Beside its batch, because SQLite writes a row as a whole, however little of it changes.
CREATE TABLE document (
  batch INTEGER PRIMARY KEY REFERENCES batch,
  text TEXT NOT NULL                       -- the signed batch, byte by byte as it is announced
);
CREATE TABLE pack (
  id INTEGER PRIMARY KEY,
  batch INTEGER NOT NULL REFERENCES batch,
  sha256 BLOB NOT NULL,
  size INTEGER NOT NULL,
  stage TEXT NOT NULL CHECK (stage IN ('new', 'sending', 'waiting', 'sent'))
);
CREATE INDEX pack_by_batch ON pack (batch);
CREATE TABLE tile (
  id INTEGER PRIMARY KEY,
  candidate BLOB NOT NULL UNIQUE,          -- SHA-256 of the sidecar: a candidate is staged once
  sha256 BLOB NOT NULL,                    -- of the encoded tile
  size INTEGER NOT NULL,
  airframe TEXT NOT NULL,
  flight TEXT NOT NULL,
  base_package BLOB NOT NULL,
  sidecar TEXT NOT NULL,
  keyid TEXT NOT NULL,
  signature BLOB NOT NULL,
  state TEXT NOT NULL REFERENCES state,
  code TEXT NOT NULL DEFAULT '',           -- of a tile that was rejected or refused
  detail TEXT NOT NULL DEFAULT '',
  batch INTEGER REFERENCES batch,
  pack INTEGER REFERENCES pack,
  changed_ms INTEGER NOT NULL
);
CREATE INDEX tile_by_state ON tile (state);
CREATE INDEX tile_by_batch ON tile (batch, sha256);
CREATE INDEX tile_by_pack ON tile (pack);
CREATE TABLE blob (tile INTEGER PRIMARY KEY REFERENCES tile, bytes BLOB NOT NULL);

CREATE TABLE state (name TEXT PRIMARY KEY, final INTEGER NOT NULL) WITHOUT ROWID;
INSERT INTO state VALUES
  ('STAGED', 0), ('SEALED', 0), ('ANNOUNCED', 0), ('SENDING', 0), ('WAITING', 0), ('SENT', 0), ('PARKED', 0),
  ('ACCEPTED', 1), ('REJECTED', 1), ('DUPLICATE', 1), ('REFUSED', 1);
CREATE TABLE step (before TEXT NOT NULL, after TEXT NOT NULL, PRIMARY KEY (before, after)) WITHOUT ROWID;
INSERT INTO step VALUES
  ('STAGED', 'SEALED'),
  ('SEALED', 'ANNOUNCED'), ('SEALED', 'SENT'), ('SEALED', 'REFUSED'),   -- missing, known, refused
  ('ANNOUNCED', 'SENDING'), ('SENDING', 'WAITING'), ('WAITING', 'SENDING'), ('SENDING', 'SENT'),
  ('SENT', 'ACCEPTED'), ('SENT', 'REJECTED'), ('SENT', 'DUPLICATE'),
  ('ANNOUNCED', 'SEALED'), ('WAITING', 'SEALED'), ('SENT', 'SEALED'),   -- the service forgot the upload
  ('SEALED', 'PARKED'), ('ANNOUNCED', 'PARKED'), ('WAITING', 'PARKED'), ('SENT', 'PARKED'), ('PARKED', 'SEALED'),
  ('REJECTED', 'STAGED'), ('REFUSED', 'STAGED');                        -- the operator tries again

CREATE TRIGGER tile_begins BEFORE INSERT ON tile WHEN NEW.state <> 'STAGED'
BEGIN SELECT RAISE(ABORT, 'a tile begins as STAGED'); END;
CREATE TRIGGER tile_steps BEFORE UPDATE OF state ON tile
WHEN NOT EXISTS (SELECT 1 FROM step WHERE before = OLD.state AND after = NEW.state)
BEGIN SELECT RAISE(ABORT, 'no such step for a tile'); END;
CREATE TRIGGER tile_stays BEFORE DELETE ON tile
BEGIN SELECT RAISE(ABORT, 'a tile is remembered for ever'); END;
CREATE TRIGGER blob_stays BEFORE DELETE ON blob
WHEN NOT (SELECT final FROM state WHERE name = (SELECT state FROM tile WHERE id = OLD.tile))
BEGIN SELECT RAISE(ABORT, 'the bytes of a tile without a final verdict'); END;
CREATE TRIGGER blob_changes BEFORE UPDATE ON blob
BEGIN SELECT RAISE(ABORT, 'the bytes of a tile never change'); END;
