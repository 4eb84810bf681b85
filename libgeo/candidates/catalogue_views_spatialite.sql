-- What people look at in the candidate service's SpatiaLite catalogue. Added to a catalogue that lacks the last one of them:
-- each statement may run again. A statement ends with a semicolon at the end of a line.
CREATE VIEW IF NOT EXISTS tile_states AS
SELECT t.id AS id, u.airframe AS airframe, u.flight AS flight, u.base_package AS base_package, t.z AS z, t.x AS x, t.y AS y,
       CASE v.verdict WHEN 0 THEN 'accepted' WHEN 1 THEN 'rejected' WHEN 2 THEN 'duplicate' ELSE 'announced' END AS state,
       v.code AS code, v.detail AS detail, t.captured_at AS captured_at, t.gsd_mm / 1000.0 AS gsd_m, t.sigma_mm / 1000.0 AS sigma_m,
       t.trust AS trust, t.geom AS geom
FROM tiles t JOIN uploads u ON u.id = t.upload LEFT JOIN verdicts v ON v.tile = t.id
WHERE t.geom IS NOT NULL;

CREATE VIEW IF NOT EXISTS promotion_states AS
SELECT p.id AS id, p.current AS current, p.z AS z, p.x AS x, p.y AS y, p.decided_at AS decided_at, p.flights AS flights,
       u.airframe AS airframe, t.captured_at AS captured_at, t.gsd_mm / 1000.0 AS gsd_m, p.geom AS geom
FROM promotions p JOIN tiles t ON t.id = p.tile JOIN uploads u ON u.id = t.upload;
INSERT OR IGNORE INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('tile_states', 'geom', 'id', 'tiles', 'geom', 1);
INSERT OR IGNORE INTO views_geometry_columns (view_name, view_geometry, view_rowid, f_table_name, f_geometry_column, read_only)
VALUES ('promotion_states', 'geom', 'id', 'promotions', 'geom', 1);
