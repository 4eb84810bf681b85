// What the two rooms of the desk share beside their HTML (room_*.html): elements by id, numbers as text, calls with
// JSON, files to save, and whether the desk answers. Whatever comes from outside is set as text, never as HTML.

const byId = (id) => document.getElementById(id);
const words = (name) => name.replaceAll("_", " ");
const metres = (value) => value === null || value === undefined ? "–" : (value < 10 ? value.toFixed(1) : value < 10000 ? Math.round(value).toString() : (value / 1000).toFixed(1) + " k") + " m";
const duration = (seconds) => seconds < 100 ? Math.round(seconds) + " s" : Math.round(seconds / 60) + " min";
const plural = (number, noun) => `${number} ${noun}${number === 1 ? "" : "s"}`;

// body: JSON, a form, or bytes. What went wrong has the answer's status, its errors, and its detail as summary.
const callJson = async (method, path, body) => {
  const plain = body === undefined || body instanceof FormData || body instanceof Blob;
  const headers = body instanceof Blob ? { "Content-Type": "application/octet-stream" } : plain ? {} : { "Content-Type": "application/json" };
  for (;;) {
    const response = await call(path, { ...headers }, undefined, { method, body: plain ? body : JSON.stringify(body) });
    if (response.status === 401) { await askForToken(); continue; }
    if (response.status === 204) return null;
    const answer = await response.json();
    if (response.ok) return answer;
    const problem = new Error([answer.detail, ...(answer.errors ?? []).map(({ pointer, detail }) => `${pointer} ${detail}`)].join("; "));
    problem.status = response.status, problem.summary = answer.detail, problem.errors = answer.errors;
    throw problem;
  }
};
const postJson = (path, body) => callJson("POST", path, body);

// Under the name that the desk gives it.
const saveFile = async (path, name) => {
  const response = await call(path);
  if (!response.ok) throw new Error((await response.json()).detail);
  const address = URL.createObjectURL(await response.blob());
  element("a", { href: address, download: /filename="([^"]+)"/.exec(response.headers.get("Content-Disposition") ?? "")?.[1] ?? name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
};

// The page is marked as stale when the desk has not answered for a while: sign() whenever it does.
const contactLimit = 6;  // s
const makeContact = (isLive) => {
  let lastContactAt = performance.now();
  setInterval(() => {
    const silence = (performance.now() - lastContactAt) / 1000, lost = silence > contactLimit;
    document.body.classList.toggle("stale", lost);
    byId("lost").hidden = !lost;
    byId("lost").textContent = lost ? `No contact with the desk for ${duration(silence)}` : "";
    byId("contact").textContent = lost ? "no contact" : isLive() ? "live" : "";
  }, 500);
  return () => { lastContactAt = performance.now(); };
};

// Which of the rooms this is.
for (const link of document.querySelectorAll("nav a")) {
  if (link.pathname === location.pathname) link.setAttribute("aria-current", "page");
}
