-- Version 2: what went wrong with a batch so often that it will be parked, counted across runs.
CREATE TABLE strike (
  batch INTEGER NOT NULL REFERENCES batch,
  kind TEXT NOT NULL,                      -- name_of(Trouble::Kind)
  count INTEGER NOT NULL,
  PRIMARY KEY (batch, kind)
) WITHOUT ROWID;
