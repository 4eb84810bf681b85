-- Version 3: a tile whose row or picture is not what was staged is set aside, and keeps no other tile from its way.
-- From SEALED on it stands in a signed batch, which is parked and taken apart; staged again, a sound copy takes its
-- place.
INSERT INTO state VALUES ('DAMAGED', 1);
INSERT INTO step VALUES
  ('STAGED', 'DAMAGED'), ('PARKED', 'DAMAGED'), ('PARKED', 'STAGED'), ('DAMAGED', 'STAGED');
