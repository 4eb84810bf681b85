-- What people look at in a PostGIS catalogue: each row with the series and sequence of its package, and whether that is the
-- newest of its series. Added to a catalogue that lacks the last one of them: each statement may run again. A statement ends
-- with a semicolon at the end of a line.
CREATE OR REPLACE VIEW nadir.package_states AS
SELECT p.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM nadir.packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       p.mission AS mission, p.created AS created, p.expires AS expires, p.tiles AS tiles, p.bytes AS bytes, p.geom AS geom
FROM nadir.packages p;

CREATE OR REPLACE VIEW nadir.finest_tiles AS
SELECT t.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM nadir.packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       t.z AS z, t.x AS x, t.y AS y, t.source AS source, t.captured_at AS captured_at, t.gsd_mm / 1000.0 AS gsd_m,
       t.ce90_mm / 1000.0 AS ce90_m, t.trust AS trust, t.sector AS sector, t.valid_ppm / 10000.0 AS valid_percent, t.geom AS geom
FROM nadir.tiles t JOIN nadir.packages p ON p.id = t.package_id
WHERE t.z = p.max_zoom;

CREATE OR REPLACE VIEW nadir.source_states AS
SELECT s.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM nadir.packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       s.provider AS provider, s.captured_at AS captured_at, s.gsd_mm / 1000.0 AS gsd_m, s.ce90_mm / 1000.0 AS ce90_m,
       s.trust AS trust, s.tiles AS tiles, s.geom AS geom
FROM nadir.sources s JOIN nadir.packages p ON p.id = s.package_id;

CREATE OR REPLACE VIEW nadir.sector_states AS
SELECT s.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM nadir.packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       s.sector AS sector, s.class AS class, s.freshness_days AS freshness_days, s.geom AS geom
FROM nadir.sectors s JOIN nadir.packages p ON p.id = s.package_id;

CREATE OR REPLACE VIEW nadir.route_states AS
SELECT r.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM nadir.packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       p.mission AS mission, r.agl_m AS agl_m, r.length_m AS length_m, r.geom AS geom
FROM nadir.routes r JOIN nadir.packages p ON p.id = r.package_id;

CREATE OR REPLACE VIEW nadir.corridor_states AS
SELECT c.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.sequence = (SELECT max(q.sequence) FROM nadir.packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       p.mission AS mission, c.half_width_m AS half_width_m, c.freshness_days AS freshness_days, c.geom AS geom
FROM nadir.corridors c JOIN nadir.packages p ON p.id = c.package_id;

-- Gaps of a package, and those of a planned mission, which has no series yet.
CREATE OR REPLACE VIEW nadir.gap_states AS
SELECT g.id AS id, p.series AS series, p.sequence AS sequence, CASE WHEN p.id IS NULL OR p.sequence = (SELECT max(q.sequence) FROM nadir.packages q WHERE q.series = p.series) THEN 1 ELSE 0 END AS current,
       g.mission AS mission, g.judged_at AS judged_at, g.z AS z, g.x AS x, g.y AS y, g.reason AS reason, g.area_m2 AS area_m2, g.sector AS sector, g.geom AS geom
FROM nadir.gaps g LEFT JOIN nadir.packages p ON p.id = g.package_id;
