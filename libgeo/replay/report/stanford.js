// Stanford diagram: the protection level of each frame over its error, both on logarithmic axes, with the alert limit.
//
//   above the diagonal   the level holds the error: available within the alert limit, unavailable beyond it
//   below the diagonal   misleading; hazardously so where the error is beyond the alert limit and the level within it

const drawStanford = (host) => {
  const points = data.frames.map((frame, index) => ({ index, error: frame.error, hpl: frame.hpl, source: frame.source }))
    .filter((point) => point.error != null && point.hpl != null);
  const card = document.getElementById("stanford-card");
  card.hidden = points.length === 0;
  if (points.length === 0) return;
  const limit = data.integrity.limit, counts = data.integrity.counts;
  const legend = document.getElementById("stanford-legend");
  for (const [name, colour] of [["available", "var(--good)"], ["unavailable", "var(--none)"], ["misleading", "var(--dead)"], ["hazardously misleading", "var(--bad)"]])
    legend.append(element("span", {}, element("i", { style: `background:${colour}` }), `${name} ${counts[name]}`));

  const largest = Math.max(...points.flatMap((point) => [point.error, point.hpl]), 2.5 * limit);
  const least = 1, decades = Math.ceil(Math.log10(largest / least)), top = least * 10 ** decades;
  const height = 380, left = 62, right = 12, bottom = 40, upper = 10;

  const draw = () => {
    const width = Math.min(Math.max(host.clientWidth, 240), 640);
    const share = (value) => Math.log10(Math.max(value, least) / least) / decades;
    const x = (error) => left + share(error) * (width - left - right);
    const y = (hpl) => height - bottom - share(hpl) * (height - bottom - upper);
    const svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img", "aria-label": "Stanford diagram: protection level over error" });
    const area = (corners, fill) => svg.append(svgElement("path", { d: "M" + corners.map(([error, hpl]) => `${x(error)} ${y(hpl)}`).join("L") + "Z", fill, "fill-opacity": .13 }));
    area([[least, least], [limit, limit], [least, limit]], "var(--good)");
    area([[least, limit], [limit, limit], [top, top], [least, top]], "var(--none)");
    area([[least, least], [limit, least], [limit, limit]], "var(--dead)");
    area([[limit, limit], [top, limit], [top, top]], "var(--dead)");
    area([[limit, least], [top, least], [top, limit], [limit, limit]], "var(--bad)");
    for (let decade = 0; decade <= decades; ++decade) {
      const value = least * 10 ** decade;
      svg.append(svgElement("line", { class: "grid", x1: left, x2: width - right, y1: y(value), y2: y(value) }));
      svg.append(svgElement("line", { class: "grid", x1: x(value), x2: x(value), y1: upper, y2: height - bottom }));
      svg.append(svgElement("text", { x: left - 8, y: y(value) + 4, "text-anchor": "end" }, value + " m"));
      svg.append(svgElement("text", { x: x(value), y: height - bottom + 17, "text-anchor": decade === decades ? "end" : "middle" }, value + " m"));
    }
    svg.append(svgElement("text", { x: (left + width - right) / 2, y: height - 4, "text-anchor": "middle" }, "error"));
    svg.append(svgElement("text", { transform: `translate(13 ${(height - bottom + upper) / 2}) rotate(-90)`, "text-anchor": "middle" }, "protection level"));
    svg.append(svgElement("path", { d: `M${x(least)} ${y(least)}L${x(top)} ${y(top)}`, stroke: "var(--soft)", "stroke-width": 1.5 }));
    svg.append(svgElement("path", { d: `M${left} ${y(limit)}H${width - right}M${x(limit)} ${upper}V${height - bottom}`, stroke: "var(--bad)", "stroke-width": 1.5, "stroke-dasharray": "6 4" }));
    svg.append(svgElement("text", { class: "limit", x: width - right - 6, y: y(limit) - 6, "text-anchor": "end" }, `alert limit ${metres(limit)}`));
    for (const point of points) {
      const dot = svgElement("circle", { cx: x(point.error), cy: y(point.hpl), r: 3.6, fill: sources[point.source].colour, stroke: "var(--card)", "stroke-width": 1 });
      dot.addEventListener("pointerenter", () => select(point.index));
      svg.append(dot);
    }
    const cursor = svgElement("g", { "pointer-events": "none" });
    svg.append(cursor);
    host.replaceChildren(svg);
    showPoint = (index) => {
      cursor.replaceChildren();
      const frame = data.frames[index];
      if (frame.error == null || frame.hpl == null) return;
      cursor.append(svgElement("circle", { cx: x(frame.error), cy: y(frame.hpl), r: 6.5, fill: sources[frame.source].colour, stroke: "var(--ink)", "stroke-width": 2 }));
    };
    if (selected >= 0) showPoint(selected);
  };
  let showPoint = () => {};
  onSelect((index) => showPoint(index));
  new ResizeObserver(draw).observe(host);
  draw();
};
