// From the mission to its package: what it is made of, the steps, how far they are and what they found. Each step is a
// command of `nadir`, shown as it can be repeated by hand.

const stepWords = {
  build: ["Build", "cut the tiles and check them"], index: ["Index", "find places without a start"], matchability: ["Matchability", "where the map can be matched"],
  sign: ["Sign", "by the key's own command; the key is not read here"], verify: ["Verify", "as the aircraft will, every byte"], predict: ["Predict", "where it would know its position"],
};
const activeStates = ["waiting", "running"];
const isActive = (job) => Boolean(job) && activeStates.includes(job.state);

const makeMissionPackage = ({ state, flush, onJob, edit }) => {
  let planning = { imagery: [], elevation: [], vectors: [], cameras: [], keys: [], trust: false }, chosen = new Map(), shownJob = null;
  const say = (text, isBad = false) => { byId("job-answer").textContent = text; byId("job-answer").className = isBad ? "bad" : ""; };

  // ---- What it is made of

  const fillSelect = (id, list, none) => {
    const before = byId(id).value;
    byId(id).replaceChildren(...list.map(({ name, problem, appointed }) => {
      const option = element("option", { value: name }, name + (problem ? `: ${problem}` : appointed === false ? " (not in the root of trust)" : ""));
      option.disabled = Boolean(problem);
      return option;
    }), element("option", { value: "" }, none));
    byId(id).value = list.some(({ name, problem }) => name === before && !problem) ? before : list.find(({ problem, appointed }) => !problem && appointed !== false)?.name ?? "";
  };
  const setPlanning = (found) => {
    planning = found;
    byId("use-imagery").replaceChildren(...found.imagery.map(({ name, problem, provider, licence }) => {
      const box = element("input", { type: "checkbox", value: name });
      box.checked = !problem, box.disabled = Boolean(problem);
      return element("label", { class: "check" }, box, element("span", {}, name, element("span", { class: problem ? "bad" : "soft" }, ` ${problem ?? [provider, licence].filter(Boolean).join(", ")}`)));
    }));
    if (found.imagery.length === 0) byId("use-imagery").append(element("p", { class: "soft" }, "No imagery: put rasters into imagery/ of the desk's folder, or start it with --imagery."));
    fillSelect("use-elevation", found.elevation, "none");
    fillSelect("use-vectors", found.vectors, "none");
    fillSelect("use-camera", found.cameras, "none");
    fillSelect("use-key", found.keys, "none");
    showSteps();
  };
  const named = (id) => byId(id).value || null;
  const imageryChosen = () => [...byId("use-imagery").querySelectorAll("input:checked")].map(({ value }) => value);
  const request = (steps) => ({ steps, imagery: imageryChosen(), elevation: named("use-elevation"), vectors: named("use-vectors"), camera: named("use-camera"), key: named("use-key"),
                                tile_format: byId("use-tiles").value, quality: Number(byId("use-quality").value) || 0, container: byId("use-container").value });

  // ---- Steps

  // Why a step cannot be run now; and whether it is wanted when nobody has said.
  const obstacle = (kind) => {
    const { doc, stored } = state(), pack = stored.package;
    if (kind === "build" && pack) return pack.of_this_mission ? "the package is there" : "a package of this sequence is there: raise the sequence, or delete it";
    if (kind === "build" && imageryChosen().length === 0) return "needs imagery";
    if (kind === "build" && doc.terrain?.mode === "dem" && !named("use-elevation")) return "needs an elevation model";
    if (kind === "sign" && !named("use-key")) return "needs a key: start the desk with --key";
    if (kind === "verify" && !planning.trust) return "needs a root of trust: start the desk with --trust";
    if (kind === "predict" && !named("use-camera")) return "needs a camera";
    if (kind === "predict" && pointsOf(doc, "route").length < 2) return "needs a route";
    return "";
  };
  const usual = (kind) => {
    const { stored } = state(), pack = stored.package;
    if (kind === "build") return !pack;
    if (kind === "index") return !pack?.indexed;
    if (kind === "matchability") return !pack?.matchability;
    if (kind === "sign") return !pack?.signed;
    if (kind === "verify") return !pack || !pack.signed;
    return !stored.prediction?.of_this_mission;
  };
  const wants = (kind) => obstacle(kind) === "" && (chosen.get(kind) ?? usual(kind));
  const stepItem = (kind) => {
    const box = element("input", { type: "checkbox" }), [name, what] = stepWords[kind] ?? [kind, ""];
    box.addEventListener("change", () => { chosen.set(kind, box.checked); showSteps(); });
    return element("li", { "data-step": kind }, element("label", { class: "check" }, box, element("span", {}, element("b", {}, name), " ", element("span", { class: "soft" }, what))),
      element("span", { class: "chip" }), element("progress", { max: 1, value: 0, "aria-label": `${name}: progress` }), element("p", { class: "soft", "data-what": "said" }),
      element("details", {}, element("summary", {}, "Command"), element("pre", { tabindex: 0, "aria-label": `Command of ${name}` })));
  };
  const showStep = (item, kind, ran) => {
    const [label, chip, progress, said, details] = item.children, box = label.firstChild, reason = obstacle(kind), active = isActive(shownJob);
    box.disabled = reason !== "" || active;
    box.checked = wants(kind);
    chip.hidden = !ran;
    chip.textContent = ran?.state ?? "";
    chip.dataset.state = ran?.state ?? "";
    progress.hidden = ran?.state !== "running";
    if (ran?.total > 0) progress.value = ran.done / ran.total; else progress.removeAttribute("value");
    const running = ran && ran.state === "running" && ran.label ? `${ran.label}${ran.total ? `: ${ran.done} of ${ran.total} ${ran.unit}` : ""}` : "";
    const took = ran && ran.seconds > 0 && ran.state !== "running" ? `${ran.seconds < 10 ? ran.seconds.toFixed(1) : Math.round(ran.seconds)} s` : "";
    const failed = ran && ["failed", "rejected"].includes(ran.state) ? ran.messages.trim().split("\n").slice(-3).join(" ") : "";
    said.textContent = [running, took, failed, !ran || ran.state !== "done" ? reason : ""].filter(Boolean).join(" · ");
    said.hidden = said.textContent === "";
    details.hidden = !ran;
    details.lastChild.textContent = ran?.command ?? "";
  };
  const showSteps = () => {
    const { stored } = state();
    if (!stored) return;
    if (byId("steps").children.length === 0) byId("steps").append(...Object.keys(stepWords).map(stepItem));
    const active = isActive(shownJob), some = Object.keys(stepWords).some(wants);
    for (const item of byId("steps").children) showStep(item, item.dataset.step, shownJob?.steps.find(({ kind }) => kind === item.dataset.step));
    byId("run-steps").disabled = active || !some || !stored.valid;
    byId("cancel-job").hidden = !active;
    const pack = stored.package;
    byId("package-facts").textContent = !pack ? (stored.valid ? "No package yet." : "No package yet: the mission is not complete.")
      : `${pack.name}: ${plural(pack.tiles, "tile")}, ${(pack.bytes / 1e6).toFixed(1)} MB, ${pack.signed ? "signed" : "not signed"}` + (pack.of_this_mission ? "" : ". The mission has changed since: the package is of an earlier state.");
    byId("fly").hidden = !pack?.signed;
    if (pack) byId("fly").href = `/#package=${encodeURIComponent(pack.name)}`;
    byId("next-sequence").hidden = !pack || active;
    byId("delete-package").hidden = !pack || active;
  };
  const setJob = (job) => { shownJob = job; showSteps(); };
  const run = async (steps = Object.keys(stepWords).filter(wants)) => {
    if (steps.length === 0 || isActive(shownJob)) return;
    say("");
    try {
      if (!await flush()) throw new Error("the last changes are not stored yet");
      const job = await postJson(`/v1/missions/${state().id}/jobs`, request(steps));
      chosen = new Map();
      onJob(job);
    } catch (problem) {
      say(problem.message, true);
    }
  };
  const cancel = async () => {
    try {
      onJob(await callJson("DELETE", `/v1/missions/${state().id}/jobs/latest`));
      say("cancelling");
    } catch (problem) {
      say(problem.message, true);
    }
  };
  byId("run-steps").addEventListener("click", () => run());
  byId("cancel-job").addEventListener("click", cancel);
  byId("next-sequence").addEventListener("click", () => edit("next sequence", (next) => { next.sequence = Number(next.sequence) + 1; }));
  for (const field of ["use-imagery", "use-elevation", "use-camera", "use-key"]) byId(field).addEventListener("change", showSteps);
  return { setPlanning, setJob, run, show: showSteps, say, clear: () => { chosen = new Map(); shownJob = null; say(""); },
           elevation: () => named("use-elevation"), camera: () => named("use-camera") };
};
