"""The same commands under every kernel of OpenBLAS that this processor runs: nothing may change.

``python tests/helpers/kernels.py`` runs the deciding tests under each of them and compares what the
examples print, to the letter; arguments are handed to pytest in the place of these tests.
"""

import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[2]
NAMES = ("Haswell", "Zen", "SkylakeX", "Sandybridge", "Prescott")
OLD = ("Sandybridge", "Prescott")  # processors that have none of NumPy's own instructions either
# rooms whose answers are choices: modes, terms, effects, guards, jumps, switches
DECIDING = (
    "effect_search effects effect_model stays discrete_stays automaton automaton_search "
    "automaton_shooting identification seeding surfaces estimators relaxations cli"
).split()
# What a process prints that runs with a kernel: those that NumPy and SciPy have loaded.
PROBE = """
import scipy.linalg
from threadpoolctl import threadpool_info
print(*sorted({one["architecture"] for one in threadpool_info() if "openblas" in one["filepath"]}))
"""
FEATURES = "import numpy; print(*numpy.show_config(mode='dicts')['SIMD Extensions']['found'])"


@dataclass
class Kernels:
    """The environments of the kernels that run here, and a word on every other name."""

    environments: dict[str, dict[str, str]] = field(default_factory=dict)
    words: list[str] = field(default_factory=list)

    @classmethod
    def of_this_processor(cls, names=NAMES) -> "Kernels":
        """Try every name; OpenBLAS may run another kernel than the one it is asked for."""
        found, running = cls(), {}
        features = _printed(FEATURES, {})
        for name in names:
            environment = {"OPENBLAS_CORETYPE": name}
            if name in OLD:
                environment["NPY_DISABLE_CPU_FEATURES"] = features
            architecture = _printed(PROBE, environment)
            if not architecture:
                found.words.append(f"{name}: left out, this processor or its BLAS cannot run it")
            elif architecture in running:
                found.words.append(f"{name}: left out, it is the kernel of {running[architecture]}")
            else:
                running[architecture] = name
                found.environments[name] = environment
        return found

    def different(self, command: list[str], folder: Path) -> list[str]:
        """Kernels under which a command prints something else than under the first, with lines."""
        # one at a time: cores are few, and what is compared are no times
        (first, wanted), *others = [
            (name, run(command, environment, folder, capture_output=True, text=True))
            for name, environment in self.environments.items()
        ]
        if wanted.returncode:
            return [f"{first}: {wanted.stderr}"]
        return [
            f"{name} instead of {first}: {line}"
            for name, done in others
            for line in _lines(wanted.stdout, done.stdout + done.stderr * bool(done.returncode))
        ]


def run(command: list[str], environment: dict[str, str], folder: Path, **how):
    """Run a command of this interpreter with more in its environment."""
    return subprocess.run(
        [sys.executable, *command], cwd=folder, env=os.environ | environment, **how
    )


def _printed(code: str, environment: dict[str, str]) -> str:
    done = run(["-c", code], environment, ROOT, capture_output=True, text=True)
    return "" if done.returncode else done.stdout.strip()


def _lines(wanted: str, printed: str) -> list[str]:
    pairs = zip(wanted.splitlines(), printed.splitlines(), strict=False)
    lines = [f"{b!r} instead of {a!r}" for a, b in pairs if a != b]
    return lines or ([] if wanted == printed else ["fewer or more lines"])


def main() -> None:
    """Run everything and say what differs."""
    from example_output import EXAMPLES, command

    kernels, failed = Kernels.of_this_processor(), []
    print(*kernels.words, sep="\n", flush=True)
    tests = sys.argv[1:] or [f"tests/{room}" for room in DECIDING]
    for name, environment in kernels.environments.items():
        print(f"-- {name}: {' '.join(tests)}", flush=True)
        if run(["-m", "pytest", "-q", *tests], environment, ROOT).returncode:
            failed.append(f"{name}: tests fail")
    for example in EXAMPLES if len(sys.argv) == 1 else ():
        print(f"-- {example.stem}", flush=True)
        with TemporaryDirectory() as folder:
            failed += kernels.different(command(example), Path(folder))
    if failed:
        raise SystemExit("\n".join(failed))


if __name__ == "__main__":
    main()
