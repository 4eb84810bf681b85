// Error, σ and protection level over time: a band up to the radius that should hold 95 % of the truth, a line for the
// protection level (broken where none is known), a dot per frame for the error.

const drawChart = (host) => {
  const scored = data.frames.some((frame) => frame.error != null);
  document.getElementById('chart-title').textContent =
      scored ? 'Error and stated accuracy over time' : 'Stated accuracy over time';
  const legend = document.getElementById("chart-legend");
  legend.append(element(
      'span', {}, element('i', {style: 'background:var(--band);border:1px solid var(--band-line)'}),
      'stated 95 % radius (2.45 σ)'));
  if (data.frames.some((frame) => frame.hpl != null)) {
    legend.append(element('span', {}, element('i', {style: 'background:var(--refined);height:3px'}), 'protection level'));
    legend.append(element('span', {}, element('i', {style: 'background:var(--bad);height:2px'}), `alert limit ${metres(data.integrity.limit)}`));
  }
  if (scored) {
    for (const [code, { label, colour }] of Object.entries(sources)) {
      if (data.frames.some((frame) => frame.source === code && frame.error != null))
        legend.append(element("span", {}, element("i", { style: `background:${colour};border-radius:50%` }), "error, " + label));
    }
  }
  const radius = (frame) => frame.east == null ? null : 2.448 * frame.sigma;
  // Levels far beyond the alert limit are cut at the top: errors must stay readable.
  const level = (frame) => frame.hpl == null ? null : Math.min(frame.hpl, 1.5 * data.integrity.limit);
  const values = data.frames.flatMap((frame) => [frame.error, radius(frame), level(frame)]).filter((v) => v != null).sort((a, b) => a - b);
  if (values.length === 0) { host.append(element("p", { class: "note" }, "No frame has a position.")); return; }
  // One wild value must not flatten everything else: what lies above the top is drawn at the edge as a triangle.
  const usual = values[Math.floor(0.97 * (values.length - 1))], largest = values[values.length - 1];
  const top = (largest < 2.5 * usual ? largest : 1.3 * usual) * 1.08 || 1;
  const height = 250, left = top >= 1000 ? 62 : 50, right = 10, bottom = 26, upper = 8;
  const times = data.frames.map((frame) => frame.time);
  const first = times[0], last = Math.max(times[times.length - 1], first + 1e-9);

  const draw = () => {
    const width = Math.max(host.clientWidth, 240);
    const x = (t) => left + (t - first) / (last - first) * (width - left - right);
    const y = (v) => height - bottom - Math.min(v, top) / top * (height - bottom - upper);
    const svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "Error and sigma over time" });
    const ticks = (span, most) => {
      const power = 10 ** Math.floor(Math.log10(span / most));
      const step = [1, 2, 5, 10].map((n) => n * power).find((s) => span / s <= most);
      return Array.from({ length: Math.floor(span / step) + 1 }, (_, i) => i * step);
    };
    for (const value of ticks(top, 5)) {
      svg.append(svgElement("line", { class: value ? "grid" : "axis", x1: left, x2: width - right, y1: y(value), y2: y(value) }));
      svg.append(svgElement("text", { x: left - 8, y: y(value) + 4, "text-anchor": "end" }, +value.toPrecision(3) + " m"));
    }
    for (const value of ticks(last - first, width / 90)) {
      if (x(first + value) > width - right - 14) continue;
      svg.append(svgElement("text", { x: x(first + value), y: height - 7, "text-anchor": value ? "middle" : "start" }, clock(value)));
    }
    let run = [];
    const flush = () => {
      if (run.length > 1) {
        const up = run.map(([t, v]) => `${x(t).toFixed(1)} ${y(v).toFixed(1)}`).join("L");
        svg.append(svgElement("path", { d: `M${x(run[0][0])} ${y(0)}L${up}L${x(run[run.length - 1][0])} ${y(0)}Z`, fill: "var(--band)" }));
        svg.append(svgElement("path", { d: "M" + up, fill: "none", stroke: "var(--band-line)", "stroke-width": 1.5 }));
      }
      run = [];
    };
    for (const frame of data.frames) radius(frame) == null ? flush() : run.push([frame.time, radius(frame)]);
    flush();
    const levels = data.frames.some((frame) => frame.hpl != null);
    if (levels && data.integrity.limit <= top) {
      const limit = y(data.integrity.limit);
      svg.append(svgElement("line", { x1: left, x2: width - right, y1: limit, y2: limit, stroke: "var(--bad)", "stroke-width": 1.2, "stroke-dasharray": "6 4" }));
    }
    let path = "", pen = "M";
    for (const frame of data.frames) {
      if (frame.hpl == null) { pen = "M"; continue; }
      path += `${pen}${x(frame.time).toFixed(1)} ${y(frame.hpl).toFixed(1)}`;
      if (pen === "M") path += "h.01";  // a level between two unknown ones is a dot
      pen = "L";
    }
    if (path) svg.append(svgElement("path", { id: "level", d: path, fill: "none", stroke: "var(--refined)", "stroke-width": 2, "stroke-linecap": "round" }));
    for (const frame of data.frames) {
      if (frame.error == null) continue;
      const px = x(frame.time), py = y(frame.error), colour = sources[frame.source].colour;
      svg.append(frame.error > top
        ? svgElement("path", { d: `M${px - 5} ${py + 8}L${px} ${py}L${px + 5} ${py + 8}Z`, fill: "var(--bad)" })
        : svgElement("circle", { cx: px, cy: py, r: 3.4, fill: colour, stroke: "var(--card)", "stroke-width": 1 }));
    }
    const cursor = svgElement("g");
    svg.append(cursor);
    svg.addEventListener("pointermove", (event) => {
      const t = first + ((event.clientX - svg.getBoundingClientRect().left) - left) / (width - left - right) * (last - first);
      let best = 0;
      times.forEach((time, index) => { if (Math.abs(time - t) < Math.abs(times[best] - t)) best = index; });
      select(best);
    });
    host.replaceChildren(svg);
    showCursor = (index) => {
      const frame = data.frames[index];
      cursor.replaceChildren(svgElement("line", { class: "cursor", x1: x(frame.time), x2: x(frame.time), y1: upper, y2: height - bottom }));
      if (frame.error != null) cursor.append(svgElement("circle", { cx: x(frame.time), cy: y(frame.error), r: 6, fill: sources[frame.source].colour, stroke: "var(--ink)", "stroke-width": 2 }));
    };
    if (selected >= 0) showCursor(selected);
  };
  let showCursor = () => {};
  onSelect((index) => showCursor(index));
  new ResizeObserver(draw).observe(host);
  draw();
};
