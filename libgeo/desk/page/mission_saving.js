// A mission's changes on their way to the desk: soon after each, one at a time, each based on the revision before it.
// Nothing is lost: without contact it is tried again, and when somebody else was faster a person decides.

const saveAfter_ms = 400, saveAgain_ms = 2000;

const makeSaving = ({ onStored, onState, onConflict }) => {
  let open = null;  // { id, revision, unsaved: the document, or null }
  let timer = null, running = null;
  const send = async (mission) => {
    while (mission.unsaved && !mission.conflict) {
      const sent = mission.unsaved;
      try {
        onState("saving", "");
        const stored = await callJson("PUT", `/v1/missions/${mission.id}`, { revision: mission.revision, mission: sent });
        mission.revision = stored.revision;
        if (mission.unsaved === sent) mission.unsaved = null;
        if (mission === open) onStored(stored, mission.unsaved === null);
      } catch (problem) {
        if (problem.status === 409) {
          mission.conflict = true;
          onState("conflict", "");
          return onConflict(await getJson(`/v1/missions/${mission.id}`));
        }
        const again = !problem.status || problem.status >= 500 || problem.status === 429;
        onState("unsaved", again ? "no contact with the desk; trying again" : problem.message);
        if (!again) return undefined;  // the next change is sent again
        await pause(saveAgain_ms);
      }
    }
    return undefined;
  };
  // Ends when all is stored, or cannot be.
  const flush = async () => {
    clearTimeout(timer);
    if (open) await (running ??= send(open).finally(() => { running = null; }));
    return !open?.unsaved;
  };
  return {
    begin: (id, revision) => { open = { id, revision, unsaved: null, conflict: false }; onState("saved", ""); },
    end: () => { open = null; },
    change: (doc) => {
      open.unsaved = structuredClone(doc);
      if (!open.conflict) onState("saving", "");
      clearTimeout(timer);
      timer = setTimeout(flush, saveAfter_ms);
    },
    // After a conflict: the document that shall hold, on top of the revision that was faster.
    resolve: (revision, doc) => {
      Object.assign(open, { revision, conflict: false, unsaved: structuredClone(doc) });
      return flush();
    },
    adopt: (revision) => { open.revision = revision; },
    flush,
    clean: () => !open?.unsaved,
    conflict: () => Boolean(open?.conflict),
    revision: () => open?.revision,
  };
};
