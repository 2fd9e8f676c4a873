// Python in a worker of its own, so that the page answers while it works.
"use strict";
const PYODIDE = "https://cdn.jsdelivr.net/pyodide/v314.0.7/full/";
// what an identification imports; the solvers of convex programs are for other work
const PACKAGES = ["numpy", "scipy", "scikit-learn", "pandas", "tqdm", "joblib", "cloudpickle",
  "matplotlib"];
let python;

const start = async ({ pyodide }) => {
  const base = new URL(pyodide || PYODIDE, location.href).href;
  const { loadPyodide } = await import(base + "pyodide.mjs");
  python = await loadPyodide({ indexURL: base });
  await python.loadPackage(PACKAGES);
  const wheel = await fetch("swsysid.whl");
  if (!wheel.ok) throw new Error(`swsysid.whl: ${wheel.statusText}`);
  python.unpackArchive(await wheel.arrayBuffer(), "wheel");
  await python.runPythonAsync(
    "from swsysid.__main__ import main; from swsysid._cli.in_browser import columns_of, identified",
  );
  return {};
};
const literal = (value) => JSON.stringify(value); // a text, or a list of texts, is the same in Python
const QUESTIONS = {
  start,
  file: async ({ name, content }) => {
    python.FS.writeFile(name, new Uint8Array(content));
    return JSON.parse(await python.runPythonAsync(`columns_of(${literal(name)})`));
  },
  identify: async ({ words }) =>
    JSON.parse(await python.runPythonAsync(`identified(main, ${literal(words)})`)),
};
onmessage = async ({ data }) => {
  try {
    postMessage(await QUESTIONS[data.kind](data));
  } catch (error) {
    const last = String(error.message || error).trim().split("\n").at(-1);
    postMessage({ refused: data.kind === "start" ? `Python cannot be loaded: ${last}` : last });
  }
};
