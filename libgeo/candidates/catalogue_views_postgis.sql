-- What people look at in the candidate service's PostGIS catalogue. Added to a catalogue that lacks the last one of them:
-- each statement may run again. A statement ends with a semicolon at the end of a line.
CREATE OR REPLACE VIEW nadir_candidates.tile_states AS
SELECT t.id AS id, u.airframe AS airframe, u.flight AS flight, u.base_package AS base_package, t.z AS z, t.x AS x, t.y AS y,
       CASE v.verdict WHEN 0 THEN 'accepted' WHEN 1 THEN 'rejected' WHEN 2 THEN 'duplicate' ELSE 'announced' END AS state,
       v.code AS code, v.detail AS detail, t.captured_at AS captured_at, t.gsd_mm / 1000.0 AS gsd_m, t.sigma_mm / 1000.0 AS sigma_m,
       t.trust AS trust, t.geom AS geom
FROM nadir_candidates.tiles t JOIN nadir_candidates.uploads u ON u.id = t.upload LEFT JOIN nadir_candidates.verdicts v ON v.tile = t.id
WHERE t.geom IS NOT NULL;

CREATE OR REPLACE VIEW nadir_candidates.promotion_states AS
SELECT p.id AS id, p.current AS current, p.z AS z, p.x AS x, p.y AS y, p.decided_at AS decided_at, p.flights AS flights,
       u.airframe AS airframe, t.captured_at AS captured_at, t.gsd_mm / 1000.0 AS gsd_m, p.geom AS geom
FROM nadir_candidates.promotions p JOIN nadir_candidates.tiles t ON t.id = p.tile JOIN nadir_candidates.uploads u ON u.id = t.upload;
