// The page: what a reader chooses goes to the worker, in which Python runs; the answer comes back.
"use strict";
const ROLES = { "": "not used", states: "a state", inputs: "an input", time: "the time",
  groups: "the number of the run" };
const one = (id) => document.getElementById(id);
const asked = new URLSearchParams(location.search);
let worker, started, since, file;

const say = (text, refused = false) => {
  one("said").textContent = text;
  one("said").className = refused ? "refused" : "";
};

// Python comes once, which takes a while; afterwards it waits in the worker.
const python = () => {
  if (!worker) {
    worker = new Worker("worker.js", { type: "module" });
    started = ask({ kind: "start", pyodide: asked.get("pyodide") });
  }
  return started;
};
const ask = (question, files = []) => new Promise((resolve) => {
  worker.onmessage = (event) => resolve(event.data);
  worker.onerror = (event) => resolve({ refused: event.message || "the worker failed" });
  worker.postMessage(question, files);
});
const busy = (what) => {
  since = Date.now();
  const beat = () => say(`${what} ... ${Math.round((Date.now() - since) / 1000)} s`);
  beat();
  const timer = setInterval(beat, 1000);
  one("go").disabled = true;
  return () => { clearInterval(timer); one("go").disabled = false; };
};
const working = async (what, question) => {
  let done = busy("Python is loaded, which takes longest at the first time");
  let answer = await python();
  done();
  if (!answer.refused) {
    done = busy(what);
    answer = await ask(question);
    done();
  } else {
    worker.terminate();
    worker = undefined;
  }
  say(answer.refused || "", Boolean(answer.refused));
  return answer;
};

const taken = async (name, content) => {
  file = name;
  one("answer").hidden = one("wishes").hidden = one("columns").hidden = true;
  const answer = await working("The file is read", { kind: "file", name, content });
  if (answer.refused) return;
  one("roles").replaceChildren(...answer.columns.map(({ name, unit, role }) => {
    const row = document.createElement("tr"), choice = document.createElement("select");
    for (const [value, text] of Object.entries(ROLES)) choice.append(new Option(text, value));
    choice.value = role;
    choice.name = name;
    choice.setAttribute("aria-label", name);
    for (const cell of [name, unit, choice]) row.insertCell().append(cell);
    return row;
  }));
  one("columns").hidden = one("wishes").hidden = false;
};
one("file").onchange = async () => {
  const [chosen] = one("file").files;
  if (chosen) await taken(chosen.name, await chosen.arrayBuffer());
};
one("example").onclick = async () => {
  const log = await fetch("cart.csv");
  await taken("cart.csv", await log.arrayBuffer());
  for (const choice of document.querySelectorAll("#roles select")) {
    choice.value = { x: "states", v: "states", force: "inputs" }[choice.name] || choice.value;
  }
};

const words = () => {
  const named = {};
  for (const choice of document.querySelectorAll("#roles select")) {
    if (choice.value) (named[choice.value] ||= []).push(choice.name);
  }
  const how = document.querySelector("[name=how]:checked").value;
  return [file, ...Object.entries(named).flatMap(([role, names]) => [`--${role}`, ...names]),
    "--modes", one("modes").value, ...(one("order").checked ? ["--order", "2"] : []),
    ...(how ? [how] : [])];
};
const link = (id, content, type) => {
  URL.revokeObjectURL(one(id).href);
  one(id).href = URL.createObjectURL(new Blob([content], { type }));
};
one("go").onclick = async () => {
  one("answer").hidden = true;
  one("stop").hidden = false;
  const answer = await working("Python works", { kind: "identify", words: words() });
  one("stop").hidden = true;
  if (answer.refused) return;
  one("report").srcdoc = answer.page || `<pre>${answer.text.replaceAll("<", "&lt;")}</pre>`;
  link("page", answer.page, "text/html");
  link("model", answer.model, "application/json");
  one("answer").hidden = false;
  one("answer").scrollIntoView();
};
// Nothing stops Python but its end: what was loaded comes again, the file is read again.
one("stop").onclick = () => location.reload();
