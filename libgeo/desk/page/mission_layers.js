// What is drawn below and along the mission: imagery straight from its files, the tiles of the package, one fact about
// each of them with its legend, its gaps, and where along the route an aircraft would know its position.

const grades = { good: "#067a4f", fair: "#b08900", poor: "#d9480f", bad: "#b3140c", unknown: "#6b7782" };
const providerColours = ["#0a58ca", "#862e9c", "#0b7285", "#5c3d1e", "#c2255c", "#067a4f"];
const percent = (share) => `${Math.round(100 * share)} %`;

// Each: the legend's rows, and the row of a tile. limits: of the mission.
const packageFacts = {
  coverage: {
    name: "Coverage and gaps",
    rows: () => [{ text: "whole", colour: grades.good }, { text: "partly empty", colour: grades.fair }, { text: "gap in what the mission needs", colour: grades.bad }],
    row: ({ valid }) => (valid >= .9995 ? 0 : 1),
  },
  freshness: {
    name: "Freshness",
    rows: () => [{ text: "up to half of the limit old", colour: grades.good }, { text: "within the limit", colour: grades.fair }, { text: "too old", colour: grades.bad }],
    row: ({ age_days, sector }, { doc }) => {
      const limit = doc.freshness_days?.[sectorsOf(doc).find(({ id }) => id === sector)?.class ?? "active"];
      return age_days > limit ? 2 : age_days > limit / 2 ? 1 : 0;
    },
  },
  resolution: {
    name: "Resolution",
    rows: ({ doc }) => [{ text: `${doc.min_resolution_m / 2} m or finer`, colour: grades.good }, { text: `up to ${doc.min_resolution_m} m`, colour: grades.fair }, { text: "too coarse", colour: grades.bad }],
    row: ({ gsd_m }, { doc }) => (gsd_m > doc.min_resolution_m ? 2 : gsd_m > doc.min_resolution_m / 2 ? 1 : 0),
  },
  provider: {
    name: "Provider",
    rows: ({ providers, licences }) => providers.map((text, i) => ({ text: licences.has(text) ? `${text} (${licences.get(text)})` : text, colour: providerColours[i % providerColours.length] })),
    row: ({ source }, { providers }) => providers.indexOf(source),
  },
  matchability: {
    name: "Matchability",
    rows: () => [{ text: "good", colour: grades.good }, { text: "weak", colour: grades.fair }, { text: "poor", colour: grades.bad }, { text: "not evaluated", colour: grades.unknown }],
    row: ({ matchability }) => ({ good: 0, weak: 1, poor: 2 })[matchability] ?? 3,
  },
};
const tileText = ({ tile, captured_at, age_days, gsd_m, ce90_m, source, valid, matchability }) =>
  `Tile ${tile}: captured ${captured_at.slice(0, 10)} (${plural(age_days, "day")} old), ${gsd_m} m, accuracy ${ce90_m} m (CE90), ${source}, ${percent(valid)} valid` +
  (matchability ? `, matchability ${matchability}` : "");

const makeMissionLayers = ({ missionMap, state }) => {
  const { leaflet: map, renderer } = missionMap;
  const uncovered = L.layerGroup().addTo(map);
  const vectors = makeVectorOverlay(map), rasters = new Map(), outlines = L.layerGroup().addTo(map), facts = L.layerGroup().addTo(map), legs = L.layerGroup().addTo(map), picked = L.layerGroup().addTo(map);
  map.createPane("imagery").classList.add("imagery-pane");
  let sources = [], packageTiles = null, packageName = null, chosenFact = "", tiles = null, gaps = null, prediction = null;
  const hidden = new Set();  // rasters that are switched off
  const say = (text) => { byId("layer-answer").textContent = text; };

  // ---- Imagery

  const addRaster = (key, pack, pathOf) => {
    const layer = makePackageTiles(pack, pathOf);
    layer.options.pane = "imagery";
    rasters.set(key, layer);
    if (!hidden.has(key)) layer.addTo(map);
  };
  const toggle = (key, label, detail) => {
    const box = element("input", { type: "checkbox" });
    box.checked = !hidden.has(key);
    box.addEventListener("change", () => {
      if (box.checked) hidden.delete(key); else hidden.add(key);
      if (box.checked) rasters.get(key).addTo(map); else rasters.get(key).remove();
    });
    return element("label", { class: "check" }, box, element("span", {}, label, element("span", { class: "soft" }, detail)));
  };
  const sourceText = ({ captured_at, gsd_m, provider, licence }) => [captured_at?.slice(0, 10), gsd_m ? `${gsd_m} m` : "", provider, licence].filter(Boolean).join(", ");
  const listImagery = () => {
    byId("layer-imagery").replaceChildren(...sources.filter(({ bounds }) => bounds).map((source) => toggle(source.name, source.name, ` ${sourceText(source)}`)),
      ...(packageTiles ? [toggle("package", "The package's own tiles", "")] : []));
  };
  const setSources = (imagery) => {
    sources = imagery;
    for (const { name, bounds, zooms } of imagery) {
      if (!bounds || rasters.has(name)) continue;
      addRaster(name, { bounds, zooms }, (z, x, y) => `/v1/imagery/${encodeURIComponent(name)}/tiles/${z}/${x}/${y}`);
      L.rectangle([[bounds[1], bounds[0]], [bounds[3], bounds[2]]], { renderer, interactive: false, fill: false, color: "#0a0f14", weight: 1, dashArray: "2 4" }).addTo(outlines);
    }
    listImagery();
  };

  // ---- What the imagery does not cover, before anything is built

  let coverage = null, coverageOf = "", coverageAsked = 0;
  const coverageStyle = { "no imagery": { color: grades.bad, dashArray: null }, "imagery too old or too coarse": { color: grades.poor, dashArray: "4 4" } };
  const drawCoverage = () => {
    uncovered.clearLayers();
    if (!coverage || !byId("layer-coverage").checked || chosenFact) return;
    L.geoJSON(coverage, { renderer, interactive: false, style: ({ properties }) => ({ renderer, weight: 1, fillOpacity: .45, ...coverageStyle[properties.reason] }) }).addTo(uncovered);
  };
  const coverageText = ({ needed_m2, missing_m2, features }) => {
    if (missing_m2 === 0) return "The imagery covers all ground that the mission needs.";
    const ofReason = Object.keys(coverageStyle).map((reason) => [reason, features.reduce((sum, { properties }) => sum + (properties.reason === reason ? properties.area_m2 : 0), 0)]);
    return `Of ${(needed_m2 / 1e6).toFixed(2)} km²: ` + ofReason.filter(([, area]) => area > 0).map(([reason, area]) => `${reason} on ${(area / 1e6).toFixed(2)} km² (${percent(area / needed_m2)})`).join(", ") + ".";
  };
  const sayCoverage = () => { byId("coverage-answer").textContent = coverage && sources.length > 0 ? coverageText(coverage) : ""; };
  const showCoverage = async () => {
    const { id, stored } = state(), mine = ++coverageAsked;
    const of = stored?.valid ? `${id} ${stored.revision} ${JSON.stringify(sources)}` : "";
    if (of === coverageOf) return sayCoverage();  // what is being read is of a mission that is no longer so
    byId("coverage-answer").textContent = of ? "Reading what the imagery covers …" : "";
    const found = of ? await getJson(`/v1/missions/${id}/layers/imagery`) : null;
    if (mine !== coverageAsked) return;
    coverageOf = of, coverage = found;
    sayCoverage();
    drawCoverage();
  };
  byId("layer-coverage").addEventListener("change", drawCoverage);

  // ---- Facts of the package

  const legend = () => {
    const rows = chosenFact && tiles ? packageFacts[chosenFact].rows(context()) : [];
    const along = prediction && byId("layer-prediction").checked
      ? [["known along this leg", grades.good], ["known now and then", grades.fair], ["hardly known", grades.poor], ["beyond the alert limit", grades.bad]].map(([text, colour]) => ({ text, colour, line: true })) : [];
    byId("legend").hidden = rows.length + along.length === 0;
    byId("legend").replaceChildren(...[...rows, ...along].map(({ text, colour, line }) => {
      const swatch = element("i", { class: line ? "line" : "", "aria-hidden": "true" });
      swatch.style.background = colour;
      return element("li", {}, swatch, text);
    }));
  };
  const context = () => {
    const providers = [...new Set((tiles?.features ?? []).map(({ properties }) => properties.source))];
    return { doc: state().doc, providers, licences: new Map(sources.filter(({ licence }) => licence).map(({ provider, licence }) => [provider, licence])) };
  };
  const drawFacts = () => {
    facts.clearLayers();
    legend();
    if (!chosenFact || !tiles) return;
    const fact = packageFacts[chosenFact], around = context(), rows = fact.rows(around);
    L.geoJSON(tiles, { renderer, style: ({ properties }) => ({ renderer, color: rows[fact.row(properties, around)]?.colour ?? grades.unknown, weight: 1, opacity: .7, fillOpacity: .35 }),
      onEachFeature: ({ properties }, layer) => layer.on("click", (event) => { L.DomEvent.stop(event); say(tileText(properties)); }) }).addTo(facts);
    if (chosenFact !== "coverage") return;
    L.geoJSON(gaps, { renderer, style: { renderer, color: grades.bad, weight: 2, fillOpacity: .6 },
      onEachFeature: ({ properties }, layer) => layer.on("click", (event) => { L.DomEvent.stop(event); say(`Gap in tile ${properties.tile}: ${properties.reason}, ${Math.round(properties.area_m2)} m²`); }) }).addTo(facts);
    say(gaps.features.length === 0 ? "No gaps." : `${plural(gaps.features.length, "tile")} with gaps.`);
  };
  const showFact = async (name) => {
    chosenFact = name;
    say("");
    drawCoverage();
    const { id, stored } = state();
    if (name && stored.package && !tiles) [tiles, gaps] = await Promise.all(["tiles", "gaps"].map((layer) => getJson(`/v1/missions/${id}/layers/${layer}`)));
    drawFacts();
  };
  const listFacts = (there) => {
    byId("layer-facts").replaceChildren(...[["", "none"], ...Object.entries(packageFacts).map(([key, { name }]) => [key, name])].map(([key, name]) => {
      const radio = element("input", { type: "radio", name: "fact", value: key });
      radio.checked = key === chosenFact;
      radio.disabled = key !== "" && !there;
      radio.addEventListener("change", () => showFact(key).catch((error) => say(error.message)));
      return element("label", { class: "check" }, radio, name);
    }));
    if (!there) byId("layer-facts").append(element("p", { class: "soft" }, "once there is a package"));
  };

  // ---- Along the route

  const ofKind = (kind) => (prediction?.features ?? []).filter(({ properties }) => properties.kind === kind);
  const legText = ({ verdict, beyond_alert_limit, begin_m, length_m, anchored_share, hpl_m, reason, remedies }) =>
    `${beyond_alert_limit ? "Beyond the alert limit" : verdict[0].toUpperCase() + verdict.slice(1)}, ${metres(length_m)} from ${metres(begin_m)}: ${percent(anchored_share)} of the looks anchor, ${hpl_m === null ? "no protection level" : `protection level up to ${metres(hpl_m)}`}` +
    (reason ? `. Why: ${reason}` : "") + (remedies?.length ? `. What helps: ${remedies.join("; ")}` : "");
  const pickLeg = (feature) => {
    picked.clearLayers();
    say(legText(feature.properties));
    const line = feature.geometry.coordinates.map(([lon, lat]) => [lat, lon]);
    L.polyline(line, { renderer, interactive: false, color: "#0a0f14", weight: 12, opacity: .45 }).addTo(picked);
    if (!map.getBounds().contains(line[0])) map.panTo(line[0], { animate: false });
  };
  const drawPrediction = () => {
    legs.clearLayers();
    picked.clearLayers();
    const wanted = prediction && byId("layer-prediction").checked;
    byId("legs").replaceChildren();
    legend();
    if (!wanted) return;
    for (const feature of ofKind("leg")) {
      const { verdict, beyond_alert_limit: beyond } = feature.properties, line = feature.geometry.coordinates.map(([lon, lat]) => [lat, lon]);
      L.polyline(line, { renderer, interactive: false, color: "#ffffff", weight: beyond ? 11 : 9 }).addTo(legs);
      const leg = L.polyline(line, { renderer, color: beyond ? grades.bad : grades[verdict], weight: beyond ? 7 : 5, bubblingMouseEvents: false }).addTo(legs);
      leg.on("mousedown", missionMap.pressRoute);
      leg.on("click", () => { if (!missionMap.justDragged()) pickLeg(feature); });
      if (verdict === "good" && !beyond) continue;
      const button = element("button", { type: "button", class: "plain" }, legText(feature.properties));
      button.addEventListener("click", () => pickLeg(feature));
      byId("legs").append(element("li", { class: beyond ? "refuse" : verdict === "poor" ? "warning" : "note" }, button));
    }
    if (byId("legs").children.length === 0) byId("legs").append(element("li", { class: "soft" }, "The aircraft would know its position along the whole route."));
  };
  byId("layer-prediction").addEventListener("change", drawPrediction);

  // What belongs to the mission's package, read again when that has changed.
  const setMission = async ({ id, stored }) => {
    const pack = stored.package, name = pack ? `${pack.name} ${pack.bytes} ${pack.signed} ${pack.matchability}` : null;
    if (name !== packageName) {
      rasters.get("package")?.remove();
      rasters.delete("package");
      packageName = name, tiles = gaps = null, packageTiles = pack;
      if (pack) addRaster("package", { bounds: pack.bounds, zooms: pack.zooms }, (z, x, y) => `/v1/missions/${id}/tiles/${z}/${x}/${y}`);
      if (pack?.vectors) vectors.load(`/v1/missions/${id}/layers/vectors`); else vectors.show(null);
      listImagery();
      listFacts(pack !== null);
      await showFact(pack ? chosenFact : "");
    }
    showCoverage().catch((error) => { byId("coverage-answer").textContent = error.message; });
    prediction = stored.prediction ? await getJson(`/v1/missions/${id}/layers/prediction`) : null;
    drawPrediction();
    if (stored.prediction && !stored.prediction.of_this_mission) say("The mission has changed since its prediction was made: predict it again.");
  };
  const clear = () => {
    packageName = "", tiles = gaps = prediction = null, chosenFact = "";
    rasters.get("package")?.remove();
    rasters.delete("package");
    packageTiles = null;
    vectors.show(null);
    coverage = null, coverageOf = "", ++coverageAsked;
    byId("coverage-answer").textContent = "";
    for (const group of [facts, legs, picked, uncovered]) group.clearLayers();
    legend();
  };
  const nearestLook = (at_m) => ofKind("look").reduce((best, { properties }) => (!best || Math.abs(properties.at_m - at_m) < Math.abs(best.at_m - at_m) ? properties : best), null);
  // What is known of the legs is drawn over the route.
  const raiseLegs = () => { for (const group of [legs, picked]) group.eachLayer((line) => line.bringToFront()); };
  return { setSources, setMission, clear, raiseLegs, redraw: drawFacts, nearestLook, bounds: () => sources.find(({ bounds }) => bounds)?.bounds ?? null };
};
