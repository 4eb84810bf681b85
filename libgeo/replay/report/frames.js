// The strip of all frames, the read-out of the selected one, the worst ones with what they matched.

const drawStrip = (host) => {
  if (data.frames.length > 400) host.style.setProperty("--cell", "7px");
  const buttons = data.frames.map((frame, index) => {
    const button = element("button", { type: "button", title: `${frame.name}: ${sources[frame.source].label}, match ${words(frame.anchor.verdict)}` },
      element("i", { style: `background:${sources[frame.source].colour}` }),
      element("u", { style: `background:${verdictColour(frame.anchor.verdict)}` }));
    for (const name of ["pointerenter", "focus", "click"]) button.addEventListener(name, () => select(index));
    return button;
  });
  host.append(...buttons);
  let before = null;
  onSelect((index) => {
    before?.classList.remove("selected");
    before = buttons[index];
    before.classList.add("selected");
  });
  const legend = document.getElementById("strip-legend");
  for (const [code, { label, colour }] of Object.entries(sources)) {
    const count = data.frames.filter((frame) => frame.source === code).length;
    if (count) legend.append(element("span", {}, element("i", { style: `background:${colour}` }), `${label} ${count}`));
  }
  const counts = {};
  for (const frame of data.frames) counts[frame.anchor.verdict] = (counts[frame.anchor.verdict] || 0) + 1;
  document.getElementById("strip-note").textContent = "The bar below each frame is its match with the map: " +
    Object.entries(counts).sort((a, b) => b[1] - a[1]).map(([code, count]) => `${words(code)} ${count}`).join(", ") + ".";
};

const imagesOf = (index) => {
  const found = data.worst.find((entry) => entry.index === index);
  if (!found) return null;
  return element("div", { class: "pair" }, element("img", { src: found.frame, alt: "the frame, north-up" }), element("img", { src: found.map, alt: "the map" }));
};

const drawReadout = (host) => {
  onSelect((index) => {
    const frame = data.frames[index], anchor = frame.anchor, source = sources[frame.source];
    const list = element("dl");
    const row = (term, text) => list.append(element("dt", {}, term), element("dd", {}, text));
    row("time", clock(frame.time) + " · frame " + (index + 1) + " of " + data.frames.length);
    if (frame.lat != null) row("position", `${frame.lat.toFixed(6)}, ${frame.lon.toFixed(6)}`);
    if (frame.error != null) row("error", metres(frame.error));
    if (frame.east != null) row("σ", metres(frame.sigma));
    if (frame.east != null) row("protection level", frame.hpl == null ? "none" : metres(frame.hpl) + (frame.hpl > data.integrity.limit ? ", NOT USABLE" : ""));
    if (frame.age != null) row("anchor age", frame.age.toFixed(1) + " s");
    row("segment", frame.segment);
    row("odometry", frame.odometry.tracked ? `${frame.odometry.inliers} points, ${metres(frame.odometry.step)}` : "not tracked");
    row('processing time', frame.latency.toFixed(0) + ' ms');
    const tried = anchor.verdict !== "not_tried";
    const verdict = element("div", { class: "verdict " + (anchor.verdict === "accepted" ? "ok" : tried ? "no" : "") },
      element("b", {}, "match " + words(anchor.verdict)), element("br"), verdicts[anchor.verdict]);
    const gates = element("dl");
    if (tried) {
      const gate = (term, text) => gates.append(element("dt", {}, term), element("dd", {}, text));
      gate("next best / best", anchor.ratio.toFixed(3));
      if (anchor.patches) gate("patches agreeing", `${anchor.inliers} of ${anchor.patches}`);
      if (anchor.residual) gate("residual", anchor.residual.toFixed(2) + " px");
      if (anchor.window) gate("searched around", "± " + metres(anchor.window));
    }
    host.replaceChildren(
      element("div", {}, element("div", { class: "name" }, frame.name), element("span", { class: "badge", style: `background:${source.colour}` }, source.label)),
      list, verdict, gates);
    const images = imagesOf(index);
    if (images) host.append(images);
    host.append(element("div", { class: "keys" }, "Point at the map, the chart or the strip; ← and → step through the frames."));
  });
};

const drawWorst = (host) => {
  if (data.worst.length === 0) { document.getElementById("worst-card").remove(); return; }
  document.getElementById("worst-title").textContent = data.frames.some((frame) => frame.error != null) ? "Frames with the largest errors" : "Frames with the weakest matches";
  for (const entry of data.worst) {
    const frame = data.frames[entry.index];
    const figure = element("figure", {}, imagesOf(entry.index), element("figcaption", {},
      element("b", {}, frame.name), element("span", {}, frame.error != null ? "error " + metres(frame.error) : "σ " + metres(frame.sigma)),
      element("span", {}, words(frame.anchor.verdict)), element("span", {}, "ratio " + frame.anchor.ratio.toFixed(2))));
    figure.addEventListener("click", () => { select(entry.index); document.getElementById("map").scrollIntoView({ behavior: "smooth", block: "center" }); });
    host.append(figure);
  }
};
