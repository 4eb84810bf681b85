-- The catalogue as a SpatiaLite database. docs/formats/catalogue.md explains the columns; catalogue_postgis.sql has
-- the same tables and columns. A statement ends with a semicolon at the end of a line.
SELECT InsertEpsgSrid(4326);

CREATE TABLE catalogue (
  id     INTEGER PRIMARY KEY,
  format TEXT NOT NULL
);

CREATE TABLE packages (
  id              INTEGER PRIMARY KEY,
  series          TEXT NOT NULL,
  sequence        BIGINT NOT NULL,
  mission         TEXT NOT NULL,
  created         TIMESTAMP NOT NULL,
  expires         TIMESTAMP NOT NULL,
  airframes       TEXT NOT NULL,
  manifest_sha256 TEXT NOT NULL,
  merkle_root     TEXT NOT NULL,
  signers         TEXT,
  min_zoom        INTEGER NOT NULL,
  max_zoom        INTEGER NOT NULL,
  tiles           BIGINT NOT NULL,
  bytes           BIGINT NOT NULL,
  UNIQUE (series, sequence)
);
SELECT AddGeometryColumn('packages', 'geom', 4326, 'MULTIPOLYGON', 'XY', 1);
SELECT CreateSpatialIndex('packages', 'geom');

CREATE TABLE sources (
  id          INTEGER PRIMARY KEY,
  package_id  BIGINT NOT NULL REFERENCES packages (id) ON DELETE CASCADE,
  provider    TEXT NOT NULL,
  captured_at TIMESTAMP NOT NULL,
  gsd_mm      BIGINT NOT NULL,
  ce90_mm     BIGINT NOT NULL,
  trust       TEXT NOT NULL,
  zoom        INTEGER NOT NULL,
  tiles       BIGINT NOT NULL
);
SELECT AddGeometryColumn('sources', 'geom', 4326, 'MULTIPOLYGON', 'XY', 1);
SELECT CreateSpatialIndex('sources', 'geom');
CREATE INDEX sources_package ON sources (package_id);

CREATE TABLE sectors (
  id             INTEGER PRIMARY KEY,
  package_id     BIGINT NOT NULL REFERENCES packages (id) ON DELETE CASCADE,
  sector         TEXT NOT NULL,
  class          TEXT NOT NULL,
  freshness_days INTEGER NOT NULL
);
SELECT AddGeometryColumn('sectors', 'geom', 4326, 'POLYGON', 'XY', 1);
SELECT CreateSpatialIndex('sectors', 'geom');
CREATE INDEX sectors_package ON sectors (package_id);

CREATE TABLE routes (
  id         INTEGER PRIMARY KEY,
  package_id BIGINT NOT NULL REFERENCES packages (id) ON DELETE CASCADE,
  agl_m      DOUBLE PRECISION NOT NULL,
  length_m   DOUBLE PRECISION NOT NULL
);
SELECT AddGeometryColumn('routes', 'geom', 4326, 'LINESTRING', 'XY', 1);
SELECT CreateSpatialIndex('routes', 'geom');
CREATE INDEX routes_package ON routes (package_id);

CREATE TABLE corridors (
  id             INTEGER PRIMARY KEY,
  package_id     BIGINT NOT NULL REFERENCES packages (id) ON DELETE CASCADE,
  half_width_m   DOUBLE PRECISION NOT NULL,
  freshness_days INTEGER NOT NULL
);
SELECT AddGeometryColumn('corridors', 'geom', 4326, 'POLYGON', 'XY', 1);
SELECT CreateSpatialIndex('corridors', 'geom');
CREATE INDEX corridors_package ON corridors (package_id);

CREATE TABLE required_tiles (
  id         INTEGER PRIMARY KEY,
  package_id BIGINT NOT NULL REFERENCES packages (id) ON DELETE CASCADE,
  z          INTEGER NOT NULL,
  x          BIGINT NOT NULL,
  y          BIGINT NOT NULL
);
SELECT AddGeometryColumn('required_tiles', 'geom', 4326, 'POLYGON', 'XY', 1);
SELECT CreateSpatialIndex('required_tiles', 'geom');
CREATE UNIQUE INDEX required_tiles_address ON required_tiles (package_id, z, x, y);

CREATE TABLE tiles (
  id          INTEGER PRIMARY KEY,
  package_id  BIGINT NOT NULL REFERENCES packages (id) ON DELETE CASCADE,
  z           INTEGER NOT NULL,
  x           BIGINT NOT NULL,
  y           BIGINT NOT NULL,
  sha256      TEXT NOT NULL,
  source      TEXT NOT NULL,
  captured_at TIMESTAMP NOT NULL,
  gsd_mm      BIGINT NOT NULL,
  ce90_mm     BIGINT NOT NULL,
  trust       TEXT NOT NULL,
  sector      TEXT,
  valid_ppm   INTEGER NOT NULL
);
SELECT AddGeometryColumn('tiles', 'geom', 4326, 'POLYGON', 'XY', 1);
SELECT CreateSpatialIndex('tiles', 'geom');
CREATE UNIQUE INDEX tiles_address ON tiles (package_id, z, x, y);

CREATE TABLE gaps (
  id         INTEGER PRIMARY KEY,
  package_id BIGINT REFERENCES packages (id) ON DELETE CASCADE,
  mission    TEXT NOT NULL,
  judged_at  TIMESTAMP NOT NULL,
  z          INTEGER NOT NULL,
  x          BIGINT NOT NULL,
  y          BIGINT NOT NULL,
  reason     TEXT NOT NULL,
  area_m2    DOUBLE PRECISION NOT NULL,
  sector     TEXT
);
SELECT AddGeometryColumn('gaps', 'geom', 4326, 'MULTIPOLYGON', 'XY', 1);
SELECT CreateSpatialIndex('gaps', 'geom');
CREATE INDEX gaps_package ON gaps (package_id);

INSERT INTO catalogue (format) VALUES ('nadir.catalogue/1');
