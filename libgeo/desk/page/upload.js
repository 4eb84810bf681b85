// Sends pictures in batches, in the order of their telemetry, and again after a break: what is there already is answered
// "known".

const batchPictures = 20, batchBytes = 24e6;

// The column "frame" of a table without quotes: the order of the pictures. Others come in the order of their names.
const orderOf = (table) => {
  const rows = table.replace(/^\uFEFF/, "").split(/\r?\n/).map((line) => line.split(","));
  const column = rows[0].indexOf("frame");
  return new Map(column < 0 ? [] : rows.slice(1).map((row, i) => [row[column], i]));
};

const sendPictures = async (flight, files, telemetryFile) => {
  const say = (text) => { byId("upload").textContent = text; };
  byId("refusals").replaceChildren();
  const table = await telemetryFile.text(), order = orderOf(table);
  const rank = (file) => order.get(file.name) ?? Number.MAX_SAFE_INTEGER;
  const waiting = [...files].sort((a, b) => rank(a) - rank(b) || a.name.localeCompare(b.name)), all = waiting.length;
  const sums = { accepted: 0, known: 0, refused: 0 };
  while (waiting.length > 0) {
    const batch = [];
    let bytes = 0;
    while (waiting.length > 0 && batch.length < batchPictures && (batch.length === 0 || bytes + waiting[0].size <= batchBytes)) {
      bytes += waiting[0].size;
      batch.push(waiting.shift());
    }
    const form = new FormData();
    form.append("telemetry", new Blob([table], { type: "text/csv" }), "telemetry.csv");
    for (const file of batch) form.append("picture", file, file.name);
    for (;;) {
      say(`sending ${all - waiting.length} of ${plural(all, "picture")}`);
      try {
        const answer = await postJson(`/v1/flights/${flight}/pictures`, form);
        for (const name of ["accepted", "known", "refused"]) sums[name] += answer[name];
        for (const { name, problem, reason } of answer.pictures) {
          if (problem) byId("refusals").append(element("li", {}, `${name}: ${words(problem)}, ${reason}`));
        }
        break;
      } catch (problem) {
        if (problem.status && ![429, 503, 507].includes(problem.status)) throw problem;
        say(`${problem.message}; trying again`);
        await pause(2000);
      }
    }
  }
  say(`${sums.accepted} accepted, ${sums.known} there already, ${sums.refused} refused`);
};
