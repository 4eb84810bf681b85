-- What people look at in a SpatiaLite catalogue: each row with the series and sequence of its package, and whether that is the
-- newest of its series. Added to a catalogue that lacks the last one of them: each statement may run again. A statement ends
-- with a semicolon at the end of a line.
CREATE VIEW IF NOT EXISTS package_states AS
SELECT p.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       p.mission AS mission, p.created AS created, p.expires AS expires, p.tiles AS tiles, p.bytes AS bytes, p.geom AS geom
FROM packages p;

CREATE VIEW IF NOT EXISTS finest_tiles AS
SELECT t.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       t.z AS z, t.x AS x, t.y AS y, t.source AS source, t.captured_at AS captured_at, t.gsd_mm / 1000.0 AS gsd_m,
       t.ce90_mm / 1000.0 AS ce90_m, t.trust AS trust, t.sector AS sector, t.valid_ppm / 10000.0 AS valid_percent, t.geom AS geom
FROM tiles t JOIN packages p ON p.id = t.package_id
WHERE t.z = p.max_zoom;

CREATE VIEW IF NOT EXISTS source_states AS
SELECT s.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       s.provider AS provider, s.captured_at AS captured_at, s.gsd_mm / 1000.0 AS gsd_m, s.ce90_mm / 1000.0 AS ce90_m,
       s.trust AS trust, s.tiles AS tiles, s.geom AS geom
FROM sources s JOIN packages p ON p.id = s.package_id;

CREATE VIEW IF NOT EXISTS sector_states AS
SELECT s.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       s.sector AS sector, s.class AS class, s.freshness_days AS freshness_days, s.geom AS geom
FROM sectors s JOIN packages p ON p.id = s.package_id;

CREATE VIEW IF NOT EXISTS route_states AS
SELECT r.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       p.mission AS mission, r.agl_m AS agl_m, r.length_m AS length_m, r.geom AS geom
FROM routes r JOIN packages p ON p.id = r.package_id;

CREATE VIEW IF NOT EXISTS corridor_states AS
SELECT c.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       p.mission AS mission, c.half_width_m AS half_width_m, c.freshness_days AS freshness_days, c.geom AS geom
FROM corridors c JOIN packages p ON p.id = c.package_id;

-- Gaps of a package, and those of a planned mission, which has no series yet.
CREATE VIEW IF NOT EXISTS gap_states AS
SELECT g.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.id IS NULL OR p.sequence = (SELECT max(q.sequence) FROM packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       g.mission AS mission, g.judged_at AS judged_at, g.z AS z, g.x AS x, g.y AS y, g.reason AS reason, g.area_m2 AS area_m2, g.sector AS sector, g.geom AS geom
FROM gaps g LEFT JOIN packages p ON p.id = g.package_id;

INSERT OR IGNORE INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('package_states', 'geom', 'id', 'packages', 'geom', 1);
INSERT OR IGNORE INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('finest_tiles', 'geom', 'id', 'tiles', 'geom', 1);
INSERT OR IGNORE INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('source_states', 'geom', 'id', 'sources', 'geom', 1);
INSERT OR IGNORE INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('sector_states', 'geom', 'id', 'sectors', 'geom', 1);
INSERT OR IGNORE INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('route_states', 'geom', 'id', 'routes', 'geom', 1);
INSERT OR IGNORE INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('corridor_states', 'geom', 'id', 'corridors', 'geom', 1);
INSERT OR IGNORE INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('gap_states', 'geom', 'id', 'gaps', 'geom', 1);
