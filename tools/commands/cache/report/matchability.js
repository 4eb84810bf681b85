// Where frames will find their place: a layer of the map, and a card of its own.

const matchWords = {
  good: "a frame may anchor on its own", weak: "only where a healthy prediction agrees", poor: "no anchor expected",
};

const drawMatchability = (layer, { square, renderer, colour, draw }) => {
  if (!map.matchability) return;
  const { cells, cell_size: size, stretches } = map.matchability;
  const looks = { good: .45, weak: .8, poor: .8 };
  for (const [x, y, name] of cells) {
    L.rectangle(square(x, y, size), { renderer, interactive: false, color: colour("card"), weight: .5, fillColor: colour("match-" + name), fillOpacity: looks[name] }).addTo(layer.matchability);
  }
  for (const points of stretches) draw(points, "blind");
};

const showPlace = ([, , name, ratio, score, entropy, texture, valid]) => {
  const list = element("dl");
  for (const [label, value] of [["class", name], ["best score elsewhere / here", ratio.toFixed(2)], ["score here", score.toFixed(2)],
    ["entropy of orientations", entropy.toFixed(2)], ["texture", texture + " grey levels/px"], ["map coverage", Math.round(100 * valid) + " %"]])
    list.append(element("dt", {}, label), element("dd", {}, value));
  document.getElementById("readout").replaceChildren(element("div", { class: "name" }, "Place: " + matchWords[name]), list,
    element("p", { class: "keys" }, "Point at a place for details. Switch “matchability” off to see the tiles."));
};

const tellMatchability = (headline) => {
  const card = document.getElementById("match-card"), match = map && map.matchability;
  if (!match) return card.remove();
  const percent = (share) => (100 * share).toFixed(1) + " %", long = (stretch) => Math.round(stretch.length_m) + " m" +
    (stretch.seconds == null ? "" : ", " + Math.round(stretch.seconds) + " s");
  const worst = match.without_good[0];
  headline(percent(match.route_share.good).split(" ")[0], "%", "of the route lies where a frame may anchor on its own", match.route_share.good > .9 ? "good" : "bad");
  headline(worst ? Math.round(worst.length_m) + "" : "0", "m", "longest segment without such a place" + (worst && worst.seconds != null ? ", " + Math.round(worst.seconds) + " s" : ""));
  const row = (kind, ...cells) => element("tr", {}, ...cells.map((cell, i) => element(kind, { class: i ? "n" : "" }, cell)));
  const table = document.getElementById("match");
  table.append(row("th", "class", "of the places", "of the route"));
  for (const name of ["good", "weak", "poor"]) {
    const line = row("td", name + ": " + matchWords[name], percent(match.share[name]), percent(match.route_share[name]));
    line.firstChild.prepend(element("i", { style: `display:inline-block;width:11px;height:11px;border-radius:3px;margin-right:8px;background:var(--match-${name})` }));
    table.append(line);
  }
  document.getElementById("match-limits").append(element("span", {}, `good to ratio ${match.good_ratio}, weak to ${match.weak_ratio}; score at least ${match.min_score}`));
  document.getElementById("match-note").textContent = `${match.places} places ${match.step_m} m apart. At each the map itself, worn as if another season and sensor ` +
    `had seen it, is searched ${match.search_m} m around, with a frame of ${Math.round(match.footprint_m)} m. What has changed on the ground since cannot be seen this way.`;
  for (const name of ["good", "weak", "poor"])
    document.getElementById("legend").append(element("span", {}, element("i", { style: `background:var(--match-${name})` }), "match: " + name));
  const stretches = document.getElementById("match-stretches");
  if (!worst) return stretches.remove();
  stretches.append(row("th", "route without a good place", "length", "after"));
  for (const stretch of match.without_good.slice(0, 8))
    stretches.append(row("td", stretch.from.map((v) => v.toFixed(6)).join(", ") + " to " + stretch.to.map((v) => v.toFixed(6)).join(", "), long(stretch), Math.round(stretch.begin_m) + " m"));
};
