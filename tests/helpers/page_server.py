"""A server of the page that runs in a browser, and of Python where Pyodide is not to be had.

Pyodide's compiled packages are on no registry. Without a folder of them this Python stands in: it
answers the five calls that the page makes, with the wheel that the page has fetched, from a process
of its own. What is then not tried is that Pyodide has the packages and runs them.
"""

import json
import subprocess
import sys
import threading
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote

STAND_IN = """
let before = Promise.resolve();
const post = async (kind, body) => {
  const answer = await fetch(`/python/${kind}`, { method: "POST", body });
  const text = await answer.text();
  if (!answer.ok) throw new Error(text);
  return text;
};
export const loadPyodide = async () => ({
  loadPackage: (names) => post("packages", JSON.stringify(names)),
  unpackArchive: (buffer) => { before = post("wheel", buffer); },
  FS: { writeFile: (name, data) => { before = post(`file/${encodeURIComponent(name)}`, data); } },
  runPythonAsync: async (code) => { await before; return post("run", code); },
});
"""

CHILD = """
import json, os, sys
answers = os.fdopen(os.dup(1), "w")
space = {}
for line in sys.stdin:
    code = json.loads(line)
    try:
        try:
            value = eval(compile(code, "page", "eval"), space)
        except SyntaxError:
            value = exec(code, space)
        answers.write(json.dumps([True, value]) + "\\n")
    except Exception as error:
        answers.write(json.dumps([False, f"{type(error).__name__}: {error}"]) + "\\n")
    answers.flush()
"""


class _Python:
    """A Python process that has the wheel and nothing of the checkout."""

    def __init__(self, folder: Path):
        self.folder, self.process = folder, None
        folder.mkdir()

    def take(self, kind: str, body: bytes) -> str:
        """One call of the page."""
        if kind == "wheel":
            path = self.folder / "swsysid-0-py3-none-any.whl"
            path.write_bytes(body)
            environment = {"PYTHONPATH": str(path), "MPLBACKEND": "Agg", "HOME": str(self.folder)}
            self.process = subprocess.Popen(
                [sys.executable, "-c", CHILD], cwd=self.folder, env=environment, text=True,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            )  # fmt: skip
        elif kind.startswith("file/"):
            (self.folder / unquote(kind.removeprefix("file/"))).write_bytes(body)
        elif kind == "run":
            self.process.stdin.write(json.dumps(body.decode()) + "\n")
            self.process.stdin.flush()
            good, value = json.loads(self.process.stdout.readline())
            if not good:
                raise ValueError(value)
            return value or ""
        return ""

    def close(self):
        """End the process."""
        if self.process is not None:
            self.process.stdin.close()
            self.process.stdout.close()
            self.process.terminate()
            self.process.wait()


class Told:
    """What the page says at the end."""

    def __init__(self):
        self._there, self.value = threading.Event(), None

    def tell(self, value):
        """Say it."""
        self.value = value
        self._there.set()

    def wait(self, seconds: float):
        """What was said, at the latest after so many seconds."""
        assert self._there.wait(seconds), "the page has said nothing"
        return self.value


@contextmanager
def served(site: Path, work: Path, pyodide: Path | str, drive: str):
    """Address of the page and what it tells.

    `pyodide` is a folder of a distribution, or "stand-in", or "" where there is none; `drive` is a
    script that is run in the page and posts its end to ``/done``.
    """
    python, told = _Python(work), Told()

    class Handler(SimpleHTTPRequestHandler):
        def __init__(self, *args):
            super().__init__(*args, directory=str(site))

        def log_message(self, *_):
            pass

        def answer(self, body: str | bytes, kind: str, code: int = 200):
            data = body.encode() if isinstance(body, str) else body
            self.send_response(code)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def do_GET(self):
            path = self.path.partition("?")[0]
            if path == "/":
                page = (site / "index.html").read_text(encoding="utf-8")
                page = page.replace("</body>", f'<script type="module">{drive}</script></body>')
                return self.answer(page, "text/html")
            if path.startswith("/pyodide/") and pyodide == "stand-in":
                return self.answer(STAND_IN, "text/javascript")
            if path.startswith("/pyodide/") and pyodide:
                data = Path(pyodide, path.removeprefix("/pyodide/")).read_bytes()
                kinds = {".mjs": "text/javascript", ".wasm": "application/wasm"}
                return self.answer(data, kinds.get(Path(path).suffix, "application/octet-stream"))
            return super().do_GET()

        def do_POST(self):
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            if self.path == "/done":
                told.tell(json.loads(body))
                return self.answer("", "text/plain")
            try:
                self.answer(python.take(self.path.removeprefix("/python/"), body), "text/plain")
            except ValueError as error:
                self.answer(str(error), "text/plain", 500)

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/?pyodide=/pyodide/", told
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
        python.close()
