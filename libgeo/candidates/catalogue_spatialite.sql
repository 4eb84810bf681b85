-- The candidate service's catalogue as a SpatiaLite database. docs/formats/candidate-service.md explains the columns;
-- catalogue_postgis.sql has the same tables and columns. A statement ends with a semicolon at the end of a line.
SELECT InsertEpsgSrid(4326);

CREATE TABLE catalogue (
  id     INTEGER PRIMARY KEY,
  format TEXT NOT NULL
);

CREATE TABLE uploads (
  id           INTEGER PRIMARY KEY,
  name         TEXT NOT NULL UNIQUE,
  batch_key    TEXT NOT NULL UNIQUE,
  batch        TEXT NOT NULL,
  body_sha256  TEXT NOT NULL,
  client       TEXT NOT NULL,
  airframe     TEXT NOT NULL,
  flight       TEXT NOT NULL,
  base_package TEXT NOT NULL,
  opened_ms    BIGINT NOT NULL,
  expires_ms   BIGINT NOT NULL,
  state        INTEGER NOT NULL,
  tiles        BIGINT NOT NULL,
  bytes        BIGINT NOT NULL
);
CREATE INDEX uploads_airframe ON uploads (airframe, opened_ms);

CREATE TABLE tiles (
  id           INTEGER PRIMARY KEY,
  upload       BIGINT NOT NULL REFERENCES uploads (id) ON DELETE CASCADE,
  place        INTEGER NOT NULL,
  z            INTEGER NOT NULL,
  x            BIGINT NOT NULL,
  y            BIGINT NOT NULL,
  sha256       TEXT NOT NULL,
  bytes        BIGINT NOT NULL,
  captured_at  TIMESTAMP NOT NULL,
  gsd_mm       BIGINT NOT NULL,
  sigma_mm     BIGINT NOT NULL,
  badness_mm   BIGINT NOT NULL,
  trust        TEXT NOT NULL,
  keyid        TEXT NOT NULL,
  signature    TEXT NOT NULL,
  sidecar      TEXT NOT NULL
);
SELECT AddGeometryColumn('tiles', 'geom', 4326, 'POLYGON', 'XY', 0);
SELECT CreateSpatialIndex('tiles', 'geom');
CREATE INDEX tiles_address ON tiles (z, x, y);
CREATE INDEX tiles_sha256 ON tiles (sha256);
CREATE UNIQUE INDEX tiles_place ON tiles (upload, place);

CREATE TABLE packs (
  id     INTEGER PRIMARY KEY,
  upload BIGINT NOT NULL REFERENCES uploads (id) ON DELETE CASCADE,
  sha256 TEXT NOT NULL,
  bytes  BIGINT NOT NULL
);
CREATE UNIQUE INDEX packs_of_upload ON packs (upload, sha256);

CREATE TABLE blobs (
  id     INTEGER PRIMARY KEY,
  sha256 TEXT NOT NULL,
  pack   TEXT NOT NULL,
  start  BIGINT NOT NULL,
  bytes  BIGINT NOT NULL
);
CREATE UNIQUE INDEX blobs_sha256 ON blobs (sha256);

CREATE TABLE verdicts (
  id             INTEGER PRIMARY KEY,
  tile           BIGINT NOT NULL REFERENCES tiles (id) ON DELETE CASCADE,
  verdict        INTEGER NOT NULL,
  code           TEXT,
  detail         TEXT NOT NULL,
  judged_at      TIMESTAMP NOT NULL,
  contrast_ppm   BIGINT,
  sharpness_ppm  BIGINT,
  base_shift_mm BIGINT,
  correlation_ppm BIGINT,
  to_vote        INTEGER NOT NULL
);
CREATE UNIQUE INDEX verdicts_tile ON verdicts (tile);
CREATE INDEX verdicts_to_vote ON verdicts (to_vote) WHERE to_vote = 1;

CREATE TABLE votes (
  id              INTEGER PRIMARY KEY,
  tile            BIGINT NOT NULL REFERENCES tiles (id) ON DELETE CASCADE,
  other           BIGINT NOT NULL REFERENCES tiles (id) ON DELETE CASCADE,
  shift_mm        BIGINT NOT NULL,
  allowed_mm      BIGINT NOT NULL,
  correlation_ppm BIGINT NOT NULL,
  agrees          INTEGER NOT NULL
);
CREATE UNIQUE INDEX votes_pair ON votes (tile, other);

CREATE TABLE promotions (
  id           INTEGER PRIMARY KEY,
  tile         BIGINT NOT NULL REFERENCES tiles (id) ON DELETE CASCADE,
  z            INTEGER NOT NULL,
  x            BIGINT NOT NULL,
  y            BIGINT NOT NULL,
  decided_at   TIMESTAMP NOT NULL,
  flights      INTEGER NOT NULL,
  evidence     TEXT NOT NULL,
  current      INTEGER NOT NULL
);
SELECT AddGeometryColumn('promotions', 'geom', 4326, 'POLYGON', 'XY', 1);
SELECT CreateSpatialIndex('promotions', 'geom');
CREATE UNIQUE INDEX promotions_address ON promotions (z, x, y) WHERE current = 1;

INSERT INTO catalogue (format) VALUES ('nadir.candidate-catalogue/1');
