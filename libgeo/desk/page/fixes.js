// Fixes: the same point in the picture and on the map, the picture dragged to where it belongs, or a place with a radius.
//
// A tool is chosen first ("pair", "drag", "place"); it fills the form, and the form is what is sent.

const makeFixTools = ({ map, openPicture, closePicture, flight, frame, footprintOf, previewOf, history, onChange }) => {
  let tool = "place", asking = null;  // "pixel" or "place" while a click is awaited
  let pixel = null;                   // { frame, x, y } that the fix is of
  const laid = makeLaidPicture(map.leaflet, { onMove: (place) => setPlace(place.lat, place.lon), onDone: () => byId("give-fix").focus() });
  const say = (text) => { byId("fix-answer").textContent = text; };
  const instructions = {
    pixel: "Click a point in the picture that you also see on the map, or move the picture and press Enter. Escape cancels.",
    pair: "Now click the same point on the map, or move the map and press Enter. Escape cancels.",
    place: "Click where the aircraft was at this frame, or move the map and press Enter. Escape cancels.",
    drag: "Drag the picture to where it belongs: mouse, finger or arrow keys; [ and ] turn it. Enter takes its place, Escape cancels.",
  };

  const setPlace = (lat, lon) => {
    byId("fix-lat").value = lat.toFixed(7);
    byId("fix-lon").value = lon.toFixed(7);
    map.setChosen({ lat, lon });
  };
  const setPixel = (chosen) => {
    pixel = chosen;
    byId("fix-pixel").textContent = pixel ? `the pixel ${Math.round(pixel.x)}, ${Math.round(pixel.y)} of frame ${pixel.frame} shows this place` : "";
  };
  const ask = (what) => {
    asking = what;
    map.askForPlace(what === "place");
    byId("asking").hidden = what === null && !laid.there();
    byId("asking").textContent = laid.there() ? instructions.drag : what === "pixel" ? instructions.pixel : instructions[tool] ?? "";
    if (what === "place") byId("map").focus({ preventScroll: true });
  };
  const show = () => {
    for (const name of ["pair", "drag", "place"]) byId("tool-" + name).setAttribute("aria-pressed", name === tool);
    byId("radius-field").hidden = tool !== "place";
    byId("sigma-field").hidden = tool === "place";
    for (const [id, wanted] of [["fix-radius", tool === "place"], ["fix-sigma", tool !== "place"]]) byId(id).required = wanted;
  };
  let turn = 0;  // a picture that was on its way when the tool was given up is not laid
  const cancel = () => {
    ++turn;
    laid.remove();
    ask(null);
    setPixel(null);
    map.setChosen(null);
    byId("fix-lat").value = byId("fix-lon").value = "";
  };
  const begin = async (name) => {
    cancel();
    tool = name;
    show();
    say("");
    const of = frame();
    if (of < 0) return say("the flight has no processed picture yet");
    if (name === "place") return ask("place");
    if (name === "pair") {
      ask("pixel");
      return openPicture(true);
    }
    closePicture();
    const mine = turn;
    const [print, address] = await Promise.all([footprintOf(of), previewOf(of)]);
    if (mine !== turn) return undefined;
    if (!print.corners) return say("the attitude that was measured shows the sky in this picture: give the same point in picture and map instead");
    const { width, height } = print.picture;
    setPixel({ frame: of, x: (width - 1) / 2, y: (height - 1) / 2 });
    laid.lay(address, print.corners, print.position ?? map.middle());
    ask(null);
  };

  const post = async (body) => postJson(`/v1/flights/${flight().id}/fixes`, body);
  const remove = async (id) => callJson("DELETE", `/v1/flights/${flight().id}/fixes/${id}`);
  // Given now, and by undoing and doing again as often as it takes: each time it is a fix of its own.
  const give = async (body, text) => {
    let fix = await post(body);
    history.add({ text, undo: async () => { await remove(fix.id); onChange(); }, redo: async () => { fix = await post(body); onChange(); } });
    onChange();
    return fix;
  };
  const bodyOf = (fix) => {
    const body = { lat: fix.lat, lon: fix.lon, by: fix.by };
    if (fix.frame !== null) body.frame = fix.frame;
    if (fix.pixel) Object.assign(body, { pixel: fix.pixel, sigma_m: fix.sigma_m });
    else body.radius_m = fix.radius_m;
    return body;
  };
  const withdraw = async (fix) => {
    let id = fix.id;
    await remove(id);
    history.add({ text: `fix ${fix.id} withdrawn`, undo: async () => { id = (await post(bodyOf(fix))).id; onChange(); }, redo: async () => { await remove(id); onChange(); } });
    onChange();
  };

  byId("fix").addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      const body = { lat: numberIn("fix-lat"), lon: numberIn("fix-lon") };
      if (tool === "place") {
        body.radius_m = numberIn("fix-radius");
        if (frame() >= 0) body.frame = frame();
      } else {
        if (!pixel) throw new Error(tool === "pair" ? "choose a point in the picture first" : "lay the picture on the map first");
        Object.assign(body, { frame: pixel.frame, pixel: { x: pixel.x, y: pixel.y }, sigma_m: numberIn("fix-sigma") });
      }
      const fix = await give(body, "fix given");
      cancel();
      say(`stored: applied before frame ${fix.before_frame}, within ${metres(fix.hint.radius_m)}`);
    } catch (problem) {
      say(problem.message);
    }
  });
  for (const name of ["pair", "drag", "place"]) byId("tool-" + name).addEventListener("click", () => begin(name).catch((problem) => say(problem.message)));
  show();

  return {
    begin: (name) => begin(name).catch((problem) => say(problem.message)),
    cancel,
    give,
    asksForPixel: () => asking === "pixel",
    // False: a click in the picture is not meant for a fix.
    onPixel: (chosen) => {
      if (asking !== "pixel") return false;
      setPixel({ frame: frame(), ...chosen });
      ask("place");
      return true;
    },
    onPlace: (lat, lon) => {
      if (asking !== "place") return;
      setPlace(lat, lon);
      ask(null);
      byId(tool === "place" ? "fix-radius" : "give-fix").focus();
    },
    marksOf: (of) => (pixel?.frame === of && tool === "pair" ? [{ ...pixel, chosen: true }] : []),
    list: (fixes) => {
      byId("fixes").replaceChildren(...fixes.map((fix) => {
        const what = fix.pixel ? `pixel ${Math.round(fix.pixel.x)}, ${Math.round(fix.pixel.y)} of frame ${fix.frame}, ± ${metres(fix.sigma_m)}`
                               : `aircraft${fix.frame === null ? "" : ` at frame ${fix.frame}`} within ${metres(fix.radius_m)}`;
        const line = element("li", { class: fix.withdrawn ? "withdrawn" : "" }, element("span", {}, `Fix ${fix.id}: ${what}, by ${fix.by}` + (fix.withdrawn ? ", withdrawn" : "")));
        if (!fix.withdrawn) {
          const button = element("button", { type: "button", "aria-label": `Withdraw fix ${fix.id}` }, "Withdraw");
          button.addEventListener("click", () => withdraw(fix).catch((problem) => say(problem.message)));
          line.append(button);
        }
        return line;
      }));
    },
  };
};
