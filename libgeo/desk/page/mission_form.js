// A mission by numbers: each member of the document that is on the map, and those that are not, as inputs. An input has
// its member's path (data-path) and how its text is read (data-kind). What is being typed is left alone.
//
//   const form = makeMissionForm({ edit: (text, mutate) => …, select: (shape, point) => …, removePart: (shape) => …, middle });
//   form.show(doc, shape, point);

const numberOf = (text) => {
  const value = Number(text.trim().replace(",", "."));
  return text.trim() !== "" && Number.isFinite(value) ? value : undefined;
};
// Text that is no number stays text: the desk's finding says what is wrong with it.
const readers = {
  number: (text) => numberOf(text) ?? (text.trim() === "" ? undefined : text),
  optional: (text) => numberOf(text) ?? (text.trim() === "" ? undefined : text),
  text: (text) => text.trim(),
  list: (text) => text.split(",").map((word) => word.trim()).filter(Boolean),
};
const textOfMember = (value) => (value === undefined || value === null ? "" : Array.isArray(value) ? value.join(", ") : String(value));
const feetText = (value) => (Number.isFinite(value) ? `${Math.round(value * feetPerMetre)} ft` : "");

// Children of a list, as many as there are items: those that stay keep the focus.
const matchChildren = (list, count, make) => {
  while (list.children.length > count) list.lastElementChild.remove();
  while (list.children.length < count) list.append(make(list.children.length));
  return [...list.children];
};
const fillInput = (input, value) => {
  const text = textOfMember(value);
  if (document.activeElement === input && input.dataset.typed === "true") return;
  if (input.value !== text) input.value = text;
};

const pointsAtOnce = 100;  // rows of a list
const heightFrames = { above_ground: "above ground", above_takeoff: "above take-off", above_sea_level: "above sea level" };

const makeMissionForm = ({ edit, select, removePart, middle }) => {
  let doc = null;
  const root = byId("mission"), firstShown = new Map();  // by shape
  const button = (text, label, act, more = {}) => {
    const made = element("button", { type: "button", "aria-label": label, ...more }, text);
    made.addEventListener("click", act);
    return made;
  };
  const input = (path, kind, label, more = {}) => element("input", { "data-path": path, "data-kind": kind, "aria-label": label, ...(kind === "number" ? { inputmode: "decimal" } : {}), ...more });

  // ---- Points

  // Beside the last point, by a tenth of a minute or the last leg; the middle of the map for the first.
  const nextPlace = (points) => {
    if (points.length === 0) return middle();
    const [lon, lat] = points.at(-1), before = points.at(-2);
    const [east, north] = before ? [lon - before[0], lat - before[1]] : [.002, 0];
    return [Math.round((lon + east) * 1e7) / 1e7, Math.round((lat + north) * 1e7) / 1e7];
  };
  const pointRow = (shape) => {
    const row = element("li", { class: "point" }), index = () => Number(row.dataset.index);
    const choose = button("", "", () => select(shape, index()), { class: "number", "aria-pressed": "false" });
    const field = (part, axis) => {
      const made = element("input", { inputmode: "decimal", "data-axis": axis });
      made.addEventListener("change", () => {
        const value = numberOf(made.value);
        if (value === undefined) { made.setAttribute("aria-invalid", true); return; }
        edit(`${nameOf(doc, shape)}: point ${index() + 1}`, (next) => {
          const place = [...pointsOf(next, shape)[index()]];
          place[part] = value;
          movePoint(next, shape, index(), place);
        });
      });
      return made;
    };
    const height = element("input", { inputmode: "decimal", "data-axis": "height", "data-kind": "number" }), feet = element("span", { class: "feet" });
    const frame = element("select", { "data-axis": "frame" });
    frame.append(...Object.entries(heightFrames).map(([value, text]) => element("option", { value }, text)));
    frame.addEventListener("change", () => edit(`height of point ${index() + 1}`, (next) => { next.route.heights.frames[index()] = frame.value; }));
    height.addEventListener("change", () => edit(`height of point ${index() + 1}`, (next) => { next.route.heights.m[index()] = readers.number(height.value) ?? null; }));
    row.append(choose, field(1, "lat"), field(0, "lon"), height, feet,
      button("+", "", () => { edit("point added", (next) => {
        const points = pointsOf(next, shape), at = points[index()], after = points[index() + 1] ?? (isRing(next, shape) ? points[0] : null);
        insertPoint(next, shape, index() + 1, after ? roundedPlace({ lng: (at[0] + after[0]) / 2, lat: (at[1] + after[1]) / 2 }) : nextPlace(points));
      }); select(shape, index() + 1); }, { "data-what": "insert" }),
      button("×", "", () => edit("point removed", (next) => removePoint(next, shape, index())), { "data-what": "remove" }), frame);
    return row;
  };
  const fillRow = (row, shape, index, place, height, chosen) => {
    const name = `point ${index + 1} of ${nameOf(doc, shape)}`, [choose, lat, lon, high, feet, insert, remove, frame] = row.children, frames = framesOf(doc, shape);
    row.dataset.index = index;
    row.dataset.path = shape === "route" ? `route.points[${index}]` : `${shape}.polygon[${index}]`;
    choose.textContent = index + 1;
    choose.setAttribute("aria-label", `Select ${name}`);
    choose.setAttribute("aria-pressed", chosen);
    for (const [field, value, label] of [[lat, place[1], "Latitude"], [lon, place[0], "Longitude"]]) {
      fillInput(field, value);
      field.setAttribute("aria-label", `${label} of ${name}`);
      field.removeAttribute("aria-invalid");
    }
    high.hidden = feet.hidden = height === undefined;
    high.dataset.path = `route.heights.m[${index}]`;
    high.setAttribute("aria-label", `Height of ${name} in metres`);
    fillInput(high, height);
    feet.textContent = feetText(height);
    frame.hidden = high.hidden || !frames;
    frame.setAttribute("aria-label", `What the height of ${name} is counted from`);
    if (frames) frame.value = frames[index];
    insert.setAttribute("aria-label", `Add a point after ${name}`);
    remove.setAttribute("aria-label", `Remove ${name}`);
    remove.disabled = false;
  };
  const fillPoints = (holder, shape, selected, point) => {
    if (holder.children.length === 0) {
      const list = element("ol", { class: "points" }), pages = element("div", { class: "buttons" });
      const turn = (by) => { firstShown.set(holder.dataset.points, Math.max(0, (firstShown.get(holder.dataset.points) ?? 0) + by)); form.show(doc, selectedNow, pointNow); };
      pages.append(button("‹", "Earlier points", () => turn(-pointsAtOnce)), element("span", { class: "soft" }), button("›", "Later points", () => turn(pointsAtOnce)));
      const add = button("Add a point", "", () => {
        const of = holder.dataset.points, count = pointsOf(doc, of).length;
        edit("point added", (next) => insertPoint(next, of, count, nextPlace(pointsOf(next, of))));
        select(of, count);
        holder.querySelector(`[data-index="${count}"] [data-axis="lat"]`)?.focus();
      }, { "data-what": "add" });
      add.removeAttribute("aria-label");
      holder.append(element("div", { class: "point heading", "aria-hidden": "true" }, element("span"), element("span", {}, "Latitude"), element("span", {}, "Longitude"), element("span", {}, "m")), list, pages, add);
    }
    holder.dataset.points = shape;
    const points = pointsOf(doc, shape), heights = heightsOf(doc, shape), [heading, list, pages, add] = holder.children;
    let first = Math.min(firstShown.get(shape) ?? 0, Math.max(0, points.length - 1));
    if (shape === selected && point !== null && (point < first || point >= first + pointsAtOnce)) first = point;
    first -= first % pointsAtOnce;
    firstShown.set(shape, first);
    holder.classList.toggle("with-heights", Boolean(heights));
    heading.hidden = points.length === 0;
    heading.children[3].hidden = !heights;
    pages.hidden = points.length <= pointsAtOnce;
    pages.children[1].textContent = `${first + 1} to ${Math.min(points.length, first + pointsAtOnce)} of ${points.length}`;
    add.textContent = `Add a point to ${nameOf(doc, shape)}`;
    const rows = matchChildren(list, Math.min(pointsAtOnce, points.length - first), () => pointRow(holder.dataset.points));
    rows.forEach((row, i) => fillRow(row, shape, first + i, isPlace(points[first + i]) ? points[first + i] : points[first + i] ?? [], heights ? heights[first + i] ?? null : undefined, shape === selected && point === first + i));
  };

  // ---- Parts

  const partItem = (list, index) => {
    const shape = `${list}[${index}]`, item = element("li", { class: "part", "data-path": shape });
    const fields = element("div", { class: "fields" });
    const labelled = (text, made) => element("label", {}, text, made);
    fields.append(labelled("Name", element("input", { "data-path": `${shape}.id`, "data-kind": "text" })));
    if (list === "sectors") {
      const classes = element("select", { "data-path": `${shape}.class`, "data-kind": "text" });
      classes.append(element("option", { value: "active" }, "changes fast"), element("option", { value: "stable" }, "stable"));
      fields.append(labelled("Ground", classes), labelled("Buffer (m)", element("input", { "data-path": `${shape}.buffer_m`, "data-kind": "optional", placeholder: "0", inputmode: "decimal" })));
    }
    const circle = element("div", { class: "fields", "data-what": "circle" });
    for (const [text, member] of [["Latitude", "lat_deg"], ["Longitude", "lon_deg"], ["Radius (m)", "radius_m"]]) {
      circle.append(labelled(text, element("input", { "data-path": `${shape}.circle.${member}`, "data-kind": "number", inputmode: "decimal" })));
    }
    item.append(element("div", { class: "row" }, button("", "", () => select(shape, null), { class: "plain", "data-what": "select" }), button("Remove", "", () => removePart(shape), { "data-what": "remove" })),
                fields, circle, element("details", { "data-what": "points" }, element("summary", {}, "Points"), element("div", { "data-points": shape })));
    return item;
  };
  const fillPart = (item, shape, selected, point) => {
    const [choose, remove] = item.querySelectorAll(":scope > .row > button"), name = nameOf(doc, shape);
    choose.textContent = memberAt(doc, shape).id || name;
    choose.setAttribute("aria-label", `Select ${name}`);
    choose.setAttribute("aria-pressed", shape === selected);
    remove.setAttribute("aria-label", `Remove ${name}`);
    const round = isCircle(doc, shape), list = item.querySelector("[data-what=points]");
    item.querySelector("[data-what=circle]").hidden = !round;
    list.hidden = round;
    if (round) return;
    list.firstChild.textContent = plural(pointsOf(doc, shape).length, "point");
    if (shape === selected && point !== null) list.open = true;
    fillPoints(list.lastChild, shape, selected, point);
  };

  // ---- All of it

  let selectedNow = null, pointNow = null;
  const form = {
    show: (document_, selected, point) => {
      doc = document_, selectedNow = selected, pointNow = point;
      matchChildren(byId("sectors"), sectorsOf(doc).length, (i) => partItem("sectors", i)).forEach((item, i) => fillPart(item, `sectors[${i}]`, selected, point));
      matchChildren(byId("no-fly"), noFlyOf(doc).length, (i) => partItem("no_fly", i)).forEach((item, i) => fillPart(item, `no_fly[${i}]`, selected, point));
      fillPoints(root.querySelector("[data-points=route]"), "route", selected, point);
      for (const field of root.querySelectorAll("[data-path][data-kind]")) {
        if (field.dataset.axis) continue;
        fillInput(field, field.dataset.kind === "frame" ? heightFrameOf(doc) : memberAt(doc, field.dataset.path));
      }
      for (const feet of root.querySelectorAll("[data-feet]")) feet.textContent = feetText(memberAt(doc, feet.dataset.feet));
      byId("name").textContent = doc.id || "mission";
    },
  };
  root.addEventListener("input", ({ target }) => { target.dataset.typed = "true"; });
  root.addEventListener("focusout", ({ target }) => { delete target.dataset.typed; });
  root.addEventListener("change", ({ target }) => {
    const { path, kind, axis } = target.dataset;
    delete target.dataset.typed;
    if (!path || !kind || axis) return;
    const label = target.closest("label")?.firstChild.data.trim() ?? path;
    edit(label, (next) => {
      if (kind === "frame") return setHeightFrame(next, target.value);
      const value = readers[kind](target.value);
      setMember(next, path, value);
      for (const optional of ["integrity", "takeoff"]) {
        if (next[optional] && Object.keys(next[optional]).length === 0) delete next[optional];
      }
      return undefined;
    });
  });
  byId("add-sector").addEventListener("click", () => {
    edit("area added", (next) => addSector(next, []));
    select(`sectors[${sectorsOf(doc).length - 1}]`, null);
    const item = byId("sectors").lastElementChild;
    item.querySelector("details").open = true;
    item.querySelector("[data-what=add]").focus();
  });
  byId("add-no-fly").addEventListener("click", () => {
    const [lon_deg, lat_deg] = middle();
    edit("no-fly circle added", (next) => addNoFly(next, { circle: { lon_deg, lat_deg, radius_m: 100 } }));
    select(`no_fly[${noFlyOf(doc).length - 1}]`, null);
    byId("no-fly").lastElementChild.querySelector("input").focus();
  });
  return form;
};
