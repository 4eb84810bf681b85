// A flight from photos as people have them: they are sent as they are, and what they do not say is asked for. The files
// stay at the desk until the flight is made, so that an answer costs no second upload.

const importPhotosAtOnce = 20, importBytesAtOnce = 24e6;
const isLog = (file) => /\.(bin|ulg|tlog)$/i.test(file.name);
const isPhoto = (file) => /\.(jpe?g|png|webp|tiff?)$/i.test(file.name);
// With the folder it was in: cameras use the same names again in each.
const nameOf = (file) => (file.webkitRelativePath || file.name).split("/").slice(-2).join("/");

// Folders that were dropped, two levels of them.
const filesOfEntry = async (entry, depth = 0) => {
  if (entry.isFile) return [await new Promise((done, failed) => entry.file(done, failed))];
  if (depth > 3) return [];
  const reader = entry.createReader(), all = [];
  for (;;) {
    const some = await new Promise((done, failed) => reader.readEntries(done, failed));
    if (some.length === 0) return all;
    for (const one of some) all.push(...await filesOfEntry(one, depth + 1));
  }
};
const droppedFiles = async (transfer) => {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (entries.length === 0) return [...transfer.files];
  return (await Promise.all(entries.map((entry) => filesOfEntry(entry)))).flat();
};

const makePhotoImport = ({ packages, onFlight }) => {
  let files = [], id = null, sent = new Set();
  const say = (text) => { byId("import-progress").textContent = text; };
  const choose = (chosen) => {
    files = chosen.filter((file) => isPhoto(file) || isLog(file));
    const photos = files.filter(isPhoto).length, logs = files.length - photos, others = chosen.length - files.length;
    byId("import-chosen").textContent = [plural(photos, "photo"), logs ? plural(logs, "log") : "", others ? `${plural(others, "other file")} left out` : ""].filter(Boolean).join(", ");
    byId("import-send").disabled = photos === 0;
    const folder = files.find((file) => file.webkitRelativePath)?.webkitRelativePath.split("/")[0];
    if (folder && !byId("import-name").value) byId("import-name").value = folder;
    byId("import-problem").textContent = logs > 1 ? "Choose one log, the autopilot's log of this flight." : "";
  };
  const show = (chosen = []) => {
    byId("import-form").reset();
    byId("import-facts").open = false;
    byId("import-package").replaceChildren(...packages().filter((pack) => pack.accepted).map((pack) => element("option", { value: pack.name }, pack.name)),
      element("option", { value: "" }, "none: odometry alone"));
    byId("import-missing").replaceChildren();
    say("");
    choose(chosen);
    byId("import").showModal();
  };
  const stated = async () => {
    const body = { name: byId("import-name").value };
    if (byId("import-package").value) body.package = byId("import-package").value;
    if (byId("import-camera").files[0]) body.camera = await byId("import-camera").files[0].text();
    if (byId("import-lat").value || byId("import-lon").value) body.start = { lat: numberIn("import-lat"), lon: numberIn("import-lon") };
    if (byId("import-gps").checked) body.start_from = "gps";
    for (const field of byId("import-facts").querySelectorAll("[data-member]")) {
      if (field.value.trim() !== "") body[field.dataset.member] = numberIn(field.id);
    }
    return body;
  };
  // What is there already is not sent again.
  const send = async () => {
    if (!id) id = (await callJson("POST", "/v1/imports")).id;
    const waiting = files.filter((file) => !sent.has(file)), refused = [];
    while (waiting.length > 0) {
      const form = new FormData(), batch = [];
      let bytes = 0;
      while (waiting.length > 0 && batch.length < importPhotosAtOnce && (batch.length === 0 || bytes + waiting[0].size <= importBytesAtOnce)) {
        bytes += waiting[0].size;
        batch.push(waiting.shift());
      }
      for (const file of batch) form.append(isLog(file) ? "log" : "photo", file, nameOf(file));
      for (;;) {
        say(`sending ${files.length - waiting.length} of ${plural(files.length, "file")}`);
        try {
          const answer = await callJson("POST", `/v1/imports/${id}/files`, form);
          refused.push(...answer.files.filter(({ outcome }) => outcome === "refused"));
          break;
        } catch (problem) {
          if (problem.status && ![429, 503].includes(problem.status)) throw problem;
          say(`${problem.message}; trying again`);
          await pause(2000);
        }
      }
      for (const file of batch) sent.add(file);
    }
    return refused;
  };
  const forget = () => {
    if (id) call(`/v1/imports/${id}`, {}, undefined, { method: "DELETE" }).catch((error) => console.info(error.message));
    id = null, files = [], sent = new Set();
  };
  const make = async () => {
    byId("import-missing").replaceChildren();
    byId("import-problem").textContent = "";
    byId("import-send").disabled = true;
    try {
      const body = await stated(), refused = await send();
      for (const { name, reason } of refused) byId("import-missing").append(element("li", {}, `${name}: ${reason}`));
      say("reading times, heights and directions");
      const made = await callJson("POST", `/v1/imports/${id}/flight`, body);
      id = null, files = [], sent = new Set();
      byId("import").close();
      onFlight(made);
    } catch (problem) {
      say("");
      byId("import-problem").textContent = problem.errors ? problem.summary : problem.message;
      for (const { detail } of problem.errors ?? []) byId("import-missing").append(element("li", {}, detail));
      if (problem.errors) byId("import-facts").open = true;
      byId("import-send").disabled = false;
    }
  };

  byId("import-folder").addEventListener("change", () => choose([...byId("import-folder").files]));
  byId("import-files").addEventListener("change", () => choose([...byId("import-files").files]));
  byId("import-form").addEventListener("submit", (event) => { event.preventDefault(); make(); });
  byId("import-cancel").addEventListener("click", () => { byId("import").close(); forget(); });
  byId("photos").addEventListener("click", () => show());
  document.addEventListener("dragover", (event) => { if (!byId("list").hidden && event.dataTransfer?.types.includes("Files")) event.preventDefault(); });
  document.addEventListener("drop", async (event) => {
    if (byId("list").hidden || !event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    show(await droppedFiles(event.dataTransfer));
  });
};
