// Calls to the service: with the token when there is one, and the event stream, resumed where it broke off.

const tokenKey = "nadir-token";
const call = (path, headers = {}, signal = undefined, options = {}) => {
  const token = sessionStorage.getItem(tokenKey);
  if (token) headers.Authorization = "Bearer " + token;
  return fetch(path, { headers, signal, cache: "no-store", ...options });
};

// Several calls may be refused at once; the question is one.
let asking = null;
const askForToken = () => asking ??= new Promise((resolve) => {
  const dialog = document.getElementById("ask"), input = document.getElementById("token");
  dialog.showModal();
  document.getElementById("give").onclick = () => {
    sessionStorage.setItem(tokenKey, input.value.trim());
    dialog.close();
    asking = null;
    resolve();
  };
});

// The connection broke, and with it the answer. Whatever else is thrown is the service's answer, or the page's own fault.
class ConnectionLost extends Error {}
const loseConnection = (error) => { throw new ConnectionLost(error.message); };

const getJson = async (path) => {
  for (;;) {
    const response = await call(path).catch(loseConnection);
    if (response.status === 401) { await askForToken(); continue; }
    if (!response.ok) throw new Error(path + ": " + response.status);
    return response.json().catch(loseConnection);
  }
};

// EventSource cannot send a token, so the stream is read by hand: fields up to an empty line make a message.
const readMessages = async (body, onMessage, onSign) => {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    onSign();
    const blocks = (rest + value).split("\n\n");
    rest = blocks.pop();
    for (const block of blocks) {
      const message = {};
      for (const line of block.split("\n")) {
        const colon = line.indexOf(":");
        if (colon > 0) message[line.slice(0, colon)] = line.slice(colon + 1).trimStart();
      }
      if (message.data) onMessage(message.event, JSON.parse(message.data), message.id);
    }
  }
};

const silenceLimit = 12000;  // ms; the service says something every 2 s
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// Ends when `ended` says so. onOpen: before the messages of each new connection; it may return the id after which they
// begin. onMessage: kind, data, and the id of those that have one. onSign: whenever anything comes.
const followEvents = async (path, { onOpen, onMessage, onSign, ended }) => {
  let lastId = "";
  while (!ended?.aborted) {
    const abort = new AbortController(), stop = () => abort.abort();
    ended?.addEventListener("abort", stop);
    let silence = setTimeout(() => abort.abort(), silenceLimit);
    try {
      lastId = (await onOpen()) ?? lastId;
      const response = await call(path, lastId ? { "Last-Event-ID": lastId } : {}, abort.signal);
      if (response.ok) {
        await readMessages(response.body, (event, data, id) => {
          if (id) lastId = id;
          onMessage(event, data, id);
        }, () => {
          onSign();
          clearTimeout(silence);
          silence = setTimeout(() => abort.abort(), silenceLimit);
        });
      }
    } catch (error) {
      console.info("event stream:", error.message);
    }
    clearTimeout(silence);
    ended?.removeEventListener("abort", stop);
    if (!ended?.aborted) await pause(1000);
  }
};
