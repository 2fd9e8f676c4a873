"""What the examples print, recorded and compared; run as a script, this file records it anew.

``python tests/helpers/example_output.py plot_emps`` runs that example, or every one without a
name, and writes what it prints to ``examples/recorded``.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("plot_*.py"))
PICTURES = Path(__file__).with_name("example_pictures.py")
# A number is no part of a name: neither x2 nor z0^2 holds one.
NUMBER = re.compile(r"(?<![\w.^])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w^]|\.\d)")
# Other processors and other builds of BLAS move the last digits.
RELATIVE = 0.02
LAST_DIGITS = 1.5


def recorded_output(example: Path) -> Path:
    """Where the output of an example is kept."""
    return example.parent / "recorded" / f"{example.stem}.txt"


def command(example: Path) -> list[str]:
    """Arguments of an interpreter: warnings as errors, pictures of nothing refused."""
    return ["-W", "error", str(PICTURES), str(example)]


def run_example(example: Path, folder) -> subprocess.CompletedProcess:
    """Run an example in a folder, headless, warnings as errors, pictures of nothing refused."""
    return subprocess.run(
        [sys.executable, *command(example)],
        cwd=folder,
        env={**os.environ, "MPLBACKEND": "Agg", "PYTHONWARNINGS": "error"},
        capture_output=True,
        text=True,
    )


def differences(expected: str, printed: str) -> list[str]:
    """Lines that differ: words exactly, numbers beyond two per cent or the last printed digit."""
    wanted, got = expected.splitlines(), printed.splitlines()
    if len(wanted) != len(got):
        return [f"{len(got)} lines instead of {len(wanted)}:\n{printed}"]
    return [
        f"line {number}: {b!r} instead of {a!r}"
        for number, (a, b) in enumerate(zip(wanted, got, strict=True), start=1)
        if not _alike(a, b)
    ]


def _alike(expected: str, printed: str) -> bool:
    same_words = NUMBER.sub("#", expected).split() == NUMBER.sub("#", printed).split()
    return same_words and all(map(_close, NUMBER.findall(expected), NUMBER.findall(printed)))


def _close(expected: str, printed: str) -> bool:
    allowed = max(RELATIVE * abs(float(expected)), LAST_DIGITS * _last_digit(expected))
    return abs(float(printed) - float(expected)) <= allowed


def _last_digit(number: str) -> float:
    """Size of one unit of the last printed digit; none for a count."""
    mantissa, _, exponent = number.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) if decimals or exponent else 0.0


def record(example: Path) -> None:
    """Run an example and keep what it prints."""
    with TemporaryDirectory() as folder:
        done = run_example(example, folder)
    if done.returncode:
        raise SystemExit(f"{example.name} fails:\n{done.stderr}")
    path = recorded_output(example)
    path.parent.mkdir(exist_ok=True)
    path.write_text(done.stdout, encoding="utf-8")
    print(f"recorded {path.name}")


if __name__ == "__main__":
    for chosen in EXAMPLES:
        if len(sys.argv) == 1 or chosen.stem in sys.argv[1:]:
            record(chosen)
