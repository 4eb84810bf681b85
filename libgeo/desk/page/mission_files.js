// Missions from files of other programs, and to them.

const makeMissionFiles = ({ state, flush, onImported }) => {
  let file = null;
  const isFiles = (event) => event.dataTransfer?.types.includes("Files");
  const choose = (chosen) => {
    file = chosen ?? null;
    byId("import-chosen").textContent = file ? `${file.name}, ${Math.ceil(file.size / 1000)} kB` : "";
    byId("import-send").disabled = !file;
  };
  const open = (chosen) => {
    byId("import-form").reset();
    byId("import-problem").textContent = "";
    choose(chosen);
    byId("import-dialog").showModal();
  };
  byId("import").addEventListener("click", () => open(null));
  byId("import-file").addEventListener("change", () => choose(byId("import-file").files[0]));
  byId("import-cancel").addEventListener("click", () => byId("import-dialog").close());
  byId("import-form").addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      const query = new URLSearchParams({ name: file.name });
      for (const name of ["id", "route"]) {
        if (byId("import-" + name).value.trim()) query.set(name, byId("import-" + name).value.trim());
      }
      if (byId("import-swapped").checked) query.set("latitude_first", "true");
      const { mission, notes } = await callJson("POST", `/v1/missions/import?${query.toString().replaceAll("+", "%20")}`, new Blob([await file.arrayBuffer()]));
      byId("import-dialog").close();
      onImported(mission, notes);
    } catch (problem) {
      byId("import-problem").textContent = problem.message;
    }
  });
  document.addEventListener("dragover", (event) => { if (!byId("list").hidden && isFiles(event)) event.preventDefault(); });
  document.addEventListener("drop", (event) => {
    if (byId("list").hidden || !isFiles(event)) return;
    event.preventDefault();
    open(event.dataTransfer.files[0]);
  });
  byId("save-as").addEventListener("click", async ({ target }) => {
    const format = target.dataset.export;
    if (!format) return;
    byId("export-answer").textContent = "";
    try {
      if (!await flush()) throw new Error("the last changes are not stored yet");
      await saveFile(`/v1/missions/${state().id}/file?format=${format}`, `mission.${format}`);
    } catch (problem) {
      byId("export-answer").textContent = problem.message;
    }
  });
};
