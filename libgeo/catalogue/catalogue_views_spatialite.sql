-- What people look at in a SpatiaLite catalogue: added to one that was made before them. A statement ends with a semicolon
-- at the end of a line.
-- What people look at: each row with the series and sequence of its package, and whether that is the newest of its series.
CREATE VIEW package_states AS
SELECT p.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       p.mission AS mission, p.created AS created, p.expires AS expires, p.tiles AS tiles, p.bytes AS bytes, p.geom AS geom
FROM packages p;

CREATE VIEW finest_tiles AS
SELECT t.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       t.z AS z, t.x AS x, t.y AS y, t.source AS source, t.captured_at AS captured_at, t.gsd_mm / 1000.0 AS gsd_m,
       t.ce90_mm / 1000.0 AS ce90_m, t.trust AS trust, t.sector AS sector, t.valid_ppm / 10000.0 AS valid_percent, t.geom AS geom
FROM tiles t JOIN packages p ON p.id = t.package_id
WHERE t.z = p.max_zoom;

CREATE VIEW source_states AS
SELECT s.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       s.provider AS provider, s.captured_at AS captured_at, s.gsd_mm / 1000.0 AS gsd_m, s.ce90_mm / 1000.0 AS ce90_m,
       s.trust AS trust, s.tiles AS tiles, s.geom AS geom
FROM sources s JOIN packages p ON p.id = s.package_id;
INSERT INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('package_states', 'geom', 'id', 'packages', 'geom', 1);
INSERT INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('finest_tiles', 'geom', 'id', 'tiles', 'geom', 1);
INSERT INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('source_states', 'geom', 'id', 'sources', 'geom', 1);
