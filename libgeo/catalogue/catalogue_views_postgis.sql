-- What people look at in a PostGIS catalogue: added to one that was made before them. A statement ends with a semicolon at
-- the end of a line.
-- What people look at: each row with the series and sequence of its package, and whether that is the newest of its series.
CREATE VIEW nadir.package_states AS
SELECT p.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM nadir.packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       p.mission AS mission, p.created AS created, p.expires AS expires, p.tiles AS tiles, p.bytes AS bytes, p.geom AS geom
FROM nadir.packages p;

CREATE VIEW nadir.finest_tiles AS
SELECT t.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM nadir.packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       t.z AS z, t.x AS x, t.y AS y, t.source AS source, t.captured_at AS captured_at, t.gsd_mm / 1000.0 AS gsd_m,
       t.ce90_mm / 1000.0 AS ce90_m, t.trust AS trust, t.sector AS sector, t.valid_ppm / 10000.0 AS valid_percent, t.geom AS geom
FROM nadir.tiles t JOIN nadir.packages p ON p.id = t.package_id
WHERE t.z = p.max_zoom;

CREATE VIEW nadir.source_states AS
SELECT s.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM nadir.packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       s.provider AS provider, s.captured_at AS captured_at, s.gsd_mm / 1000.0 AS gsd_m, s.ce90_mm / 1000.0 AS ce90_m,
       s.trust AS trust, s.tiles AS tiles, s.geom AS geom
FROM nadir.sources s JOIN nadir.packages p ON p.id = s.package_id;
