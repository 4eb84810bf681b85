-- Version 4: what each aircraft reported to have installed, the latest report alone, on its way to the service.
CREATE TABLE installed (
  airframe TEXT PRIMARY KEY,
  number INTEGER NOT NULL,                 -- of the report
  document TEXT NOT NULL,                  -- as the aircraft signed it
  stage TEXT NOT NULL CHECK (stage IN ('new', 'sent', 'refused')),
  detail TEXT NOT NULL DEFAULT ''          -- why it was refused
) WITHOUT ROWID;
