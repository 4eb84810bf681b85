// The texts of the panel. Whatever comes from outside is set as text, never as HTML.

const sourceWords = { satellite_anchored: "matched with the map", vo_extrapolated: "visual odometry", dead_reckoned: "dead reckoning", no_fix: "not known" };
const kindWords = { online: "as it came", refined: "refined", adjusted: "adjusted" };
const verdictWords = {
  not_tried: "not looked", accepted: "accepted", frame_unfit: "picture unfit", no_map: "off the map", ambiguous: "ambiguous",
  few_inliers: "too few patches agree", bad_geometry: "geometry not credible", off_prediction: "contradicts the track", awaiting_votes: "plausible, needs support",
};

const showFlights = (flights) => {
  byId("flights").replaceChildren(...flights.map((flight) => {
    const { accepted, processed } = flight.pictures;
    const link = element("a", { href: "#" + flight.id }, element("b", {}, flight.name || flight.id), element("span", { class: "chip", "data-state": flight.state }, flight.state),
                         element("span", {}, flight.reason ?? (accepted === processed ? plural(accepted, "picture") : `${processed} of ${plural(accepted, "picture")}`)),
                         element("span", {}, flight.created.slice(0, 16).replace("T", " ")));
    return element("li", {}, link);
  }));
  if (flights.length === 0) byId("flights").append(element("li", { class: "soft" }, "none yet"));
};

const showPackages = (packages) => {
  byId("packages").replaceChildren(...packages.map((pack) => element("li", {}, element("b", {}, pack.name), " ",
    element("span", {}, pack.accepted ? `${pack.mission}, until ${pack.expires.slice(0, 10)}` : `not accepted: ${pack.reason}`))));
  if (packages.length === 0) byId("packages").append(element("li", { class: "soft" }, "none: put them into packages/ of the desk's folder"));
};

const showFlightHead = (flight) => {
  const { accepted, processed } = flight.pictures;
  byId("name").textContent = flight.name || flight.id;
  byId("state").textContent = flight.state;
  byId("state").dataset.state = flight.state;
  byId("reason").hidden = !(flight.reason ?? flight.diagnosis);
  byId("reason").textContent = flight.reason ?? flight.diagnosis ?? "";
  byId("progress").max = Math.max(1, accepted);
  byId("progress").value = processed;
  byId("counts").textContent = `${processed} of ${plural(accepted, "picture")}` + (flight.package ? `, map ${flight.package}` : ", odometry alone");
  byId("complete").disabled = accepted === 0 || flight.completed || flight.completion_requested;
  document.title = `${flight.name || flight.id} · Nadir desk`;
};

const showSegments = (segments) => {
  byId("segments").tBodies[0].replaceChildren(...segments.map((segment) => {
    const colour = svgElement("svg", { viewBox: "0 0 14 14", "aria-hidden": "true" });
    colour.append(svgElement("rect", { width: 14, height: 14, rx: 3, fill: segmentColour(segment.segment) }));
    return element("tr", {}, element("td", {}, colour, String(segment.segment)), element("td", {}, `${segment.first_frame} – ${segment.last_frame}`), element("td", {}, segment.state, ...(segment.state === "merged" ? [element("button", { type: "button", "data-take-back": segment.segment, "aria-label": `Take the placement of segment ${segment.segment} back` }, "Take back")] : [])));
  }));
};

const showFigures = (estimate) => {
  const position = estimate?.position;
  byId("frame-heading").textContent = estimate ? `Frame ${estimate.frame}` : "Frame";
  byId("picture-name").textContent = estimate?.name ?? "–";
  byId("position").textContent = position ? `${position.lat.toFixed(6)}, ${position.lon.toFixed(6)}` : "not known";
  byId("sigma").textContent = metres(position?.sigma_m);
  byId("hpl").textContent = metres(position?.hpl_m);
  byId("source").textContent = estimate ? sourceWords[estimate.source] ?? estimate.source : "–";
};
const showVerdict = (verdict, look = null) => {
  const looked = look && look.patches > 0 ? `, ${look.inliers} of ${look.patches} patches agree` : "";
  const where = look?.of === "placement" ? ", where its segment was placed" : "";
  byId("verdict").textContent = verdict ? (verdictWords[verdict] ?? words(verdict)) + looked + where : "–";
};

// After looks in flight, or after the segment was searched as a whole.
const lostBecause = (e) => (e.failed_looks ? `${e.failed_looks} looks in a row found nothing` : `segment ${e.segment} could not be placed`);
const eventWords = {
  flight_created: () => "flight created",
  pictures_accepted: (e) => `${plural(e.accepted, "picture")} accepted` + (e.refused.length ? `, ${e.refused.length} refused` : ""),
  segment_started: (e) => `segment ${e.segment} begins`,
  segment_anchored: (e) => `segment ${e.segment} anchored to the map`,
  segments_merged: (e) => (e.by === "ground" ? `segment ${e.segment} placed by the ground that it shares with segment ${e.onto.join(", ")}: ${plural(e.hits, "frame")} agree`
                                             : `segment ${e.segment} placed as a whole: ${e.hits} of ${plural(e.looks, "look")} agree`),
  merge_withdrawn: (e) => `segment ${e.segment} floats again`,
  search_expanded: (e) => (e.by === "index" ? `segment ${e.segment}: searching similar places` : `searching ${Math.round(e.to_m)} m around`),
  user_input_needed: (e) => `lost: ${lostBecause(e)}`,
  user_fix: (e) => `fix by ${e.by} within ${metres(e.radius_m)}`,
  diagnosis_changed: (e) => (e.diagnosis ? `nothing matches: ${e.diagnosis}` : "pictures match the map now"),
  fix_withdrawn: (e) => `fix ${e.fix} withdrawn`,
  processing_blocked: (e) => `blocked: ${e.reason}`,
  flight_completed: (e) => `completed: ${e.placed} of ${plural(e.frames, "frame")} placed`,
};
const eventsShown = 40;
const showEvent = (kind, event) => {
  if (!eventWords[kind]) return;
  const line = element("li", { class: ["user_input_needed", "processing_blocked"].includes(kind) || (kind === "diagnosis_changed" && event.diagnosis) ? "warn" : "" }, element("time", {}, event.time.slice(11, 19)),
                       (event.frame === undefined ? "" : `frame ${event.frame}: `) + eventWords[kind](event));
  byId("events").prepend(line);
  while (byId("events").children.length > eventsShown) byId("events").lastChild.remove();
};
