"""A model as the C file that it writes, compiled and rolled out."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

# what a test has to see of a state whose struct it does not know
_SEEN = """
int seen_size(void) { return (int)sizeof(model_state); }
int seen_mode(const model_state *s) { return s->mode; }
double seen_time(const model_state *s) { return s->t; }
const double *seen_state(const model_state *s) { return s->x; }
"""
_STRICT = "-std=c99 -Wall -Wextra -Wpedantic -Werror -O2 -shared -fPIC".split()


class CompiledModel:
    """Rollouts of the C file of a model; a test without a compiler is skipped."""

    def __init__(self, model, folder):
        if shutil.which("gcc") is None:
            pytest.skip("needs gcc")
        source, library = folder / "model.c", folder / "model.so"
        model.to_c(source)
        source.write_text(source.read_text("utf-8") + _SEEN, "utf-8")
        done = subprocess.run(
            ["gcc", *_STRICT, "-o", library, source, "-lm"], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        self.library = ctypes.CDLL(str(library))
        self.library.seen_time.restype = ctypes.c_double
        self.library.seen_state.restype = ctypes.POINTER(ctypes.c_double)

    def begun(self, *arguments):
        """A state that has been begun."""
        state = ctypes.create_string_buffer(self.library.seen_size())
        assert self.library.model_begin(state, *arguments) == 0
        return state

    def rollout(self, x0, t, inputs=None, label=-1, hold="zero"):
        """States, modes and the instants of (kind of) events, as `simulate` has them."""
        library, double = self.library, ctypes.c_double
        u = np.zeros((len(t), 1)) if inputs is None else np.asarray(inputs, dtype=float)
        s = self.begun(double(t[0]), array(x0), array(u[0]), label)
        states, modes, events = [library.seen_state(s)[: len(x0)]], [library.model_mode(s)], []
        for k in range(len(t) - 1):
            end = u[k + 1] if hold == "linear" else u[k]
            code = 1
            while code == 1:
                code = library.model_step(
                    s, double(t[k]), array(u[k]), double(t[k + 1]), array(end)
                )
                if code == 1:
                    events.append((library.seen_time(s), library.seen_mode(s)))
            assert code == 0, (code, library.seen_time(s))
            states.append(library.seen_state(s)[: len(x0)])
            modes.append(library.model_mode(s))
        return np.array(states), np.array(modes), events


def array(values):
    """Numbers for C."""
    return (ctypes.c_double * max(len(values), 1))(*values)
