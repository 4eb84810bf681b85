// Objects: points that a person marks in pictures, their places with 95 % ellipses, and their list.

const makeObjects = ({ map, openPicture, flight, frame, history, onMarks, onFrame }) => {
  let objects = [], marking = null;  // "new", or the number of the object that the next click is a sighting of
  const say = (text) => { byId("object-answer").textContent = text; };
  const path = () => `/v1/flights/${flight().id}/objects`;
  const refresh = async () => {
    const shown = flight();
    const found = (await getJson(`/v1/flights/${shown.id}/objects`)).objects;
    if (shown !== flight()) return;
    objects = found;
    map.setObjects(objects);
    list();
    onMarks();
  };
  const mark = (what) => {
    marking = what;
    byId("mark").setAttribute("aria-pressed", what === "new");
    for (const button of document.querySelectorAll("#objects [data-sighting]")) button.setAttribute("aria-pressed", Number(button.dataset.sighting) === what);
    say(what === null ? "" : `Click the object in the picture, or move the picture and press Enter.${what === "new" ? "" : " Choose another frame for another view."}`);
    openPicture(what !== null);
    onMarks();
  };

  // Undone and done again, an object gets another number: actions follow it.
  const addObject = async (body) => {
    let object = await postJson(path(), body);
    history.add({ text: "object marked", undo: async () => { await callJson("DELETE", `${path()}/${object.id}`); await refresh(); },
                  redo: async () => { object = await postJson(path(), body); await refresh(); } });
    return object;
  };
  const addSighting = async (id, body) => {
    const newest = (object) => object.sightings.at(-1).id;
    let sighting = newest(await postJson(`${path()}/${id}/sightings`, body));
    history.add({ text: "sighting marked", undo: async () => { await callJson("DELETE", `${path()}/${id}/sightings/${sighting}`); await refresh(); },
                  redo: async () => { sighting = newest(await postJson(`${path()}/${id}/sightings`, body)); await refresh(); } });
  };
  const restore = async (object) => {
    const [first, ...rest] = object.sightings;
    const { id } = await postJson(path(), { name: object.name, by: object.by, frame: first.frame, pixel: first.pixel });
    for (const { frame: of, pixel } of rest) await postJson(`${path()}/${id}/sightings`, { frame: of, pixel });
    return id;
  };
  const remove = async (object) => {
    let { id } = object;
    await callJson("DELETE", `${path()}/${id}`);
    history.add({ text: "object removed", undo: async () => { id = await restore(object); await refresh(); },
                  redo: async () => { await callJson("DELETE", `${path()}/${id}`); await refresh(); } });
    await refresh();
  };
  const rename = async (object, name) => {
    const put = async (text) => { await callJson("PATCH", `${path()}/${object.id}`, { name: text }); await refresh(); };
    await put(name);
    history.add({ text: "object named", undo: () => put(object.name), redo: () => put(name) });
  };
  const guarded = (work) => work.catch((problem) => say(problem.message));

  const placeText = ({ place, reason, sightings }) => {
    if (!place) return `no place: ${reason}`;
    return `${place.lat.toFixed(6)}, ${place.lon.toFixed(6)} ± ${metres(place.ellipse_95.major_m)} (95 %), ${plural(sightings.length, "sighting")}` +
      (place.agrees ? "" : "; the sightings do not show the same point");
  };
  const list = () => {
    byId("objects").replaceChildren(...objects.map((object) => {
      const name = element("input", { value: object.name, maxlength: 100, "aria-label": `Name of object ${object.id}`, placeholder: `object ${object.id}` });
      name.addEventListener("change", () => guarded(rename(object, name.value.trim())));
      const button = (text, label, act, more = {}) => {
        const made = element("button", { type: "button", "aria-label": `${label} object ${object.id}`, ...more }, text);
        made.addEventListener("click", act);
        return made;
      };
      return element("li", {}, name, element("span", { class: object.place?.agrees === false || !object.place ? "bad" : "" }, placeText(object)),
        element("div", { class: "buttons" },
          button("Mark again", "Mark again, in another picture,", () => mark(marking === object.id ? null : object.id), { "data-sighting": object.id, "aria-pressed": marking === object.id }),
          button("Show", "Show", () => { if (object.place) map.goTo(object.place.lat, object.place.lon); onFrame(object.sightings[0].frame); }),
          button("Remove", "Remove", () => guarded(remove(object)))));
    }));
    byId("object-exports").hidden = objects.length === 0;
  };
  byId("mark").addEventListener("click", () => mark(marking === "new" ? null : "new"));

  return {
    refresh,
    marking: () => marking !== null,
    begin: () => mark("new"),
    cancel: () => { if (marking !== null) mark(null); },
    clear: () => { objects = []; marking = null; byId("mark").setAttribute("aria-pressed", false); say(""); list(); },
    onPixel: (pixel) => {
      if (marking === null || frame() < 0) return;
      const body = { frame: frame(), pixel };
      guarded((marking === "new" ? addObject(body) : addSighting(marking, body)).then(async () => {
        const made = marking === "new";
        mark(null);
        await refresh();
        say("");
        if (made) byId("objects").lastElementChild?.querySelector("input").focus();
      }));
    },
    marksOf: (of) => objects.flatMap((object) => object.sightings.filter((sighting) => sighting.frame === of)
      .map(({ pixel }) => ({ ...pixel, text: object.name || `object ${object.id}` }))),
  };
};
