"""Run an example and refuse pictures of nothing: ``python tests/helpers/example_pictures.py FILE``.

What the example prints goes to the standard output. A panel in which all curves are zero, or a
logarithmic axis that reaches down to rounding errors, ends the run with a sentence and status 1.
"""

import runpy
import sys

import numpy as np

# A logarithmic axis spans no more than this: double precision has sixteen digits.
LARGEST_RATIO = 1e9


def complaints(figure) -> list[str]:
    """What is wrong with the panels of a figure."""
    found = []
    for ax in figure.axes:
        name = ax.get_ylabel() or ax.get_title() or "a panel"
        curves = [np.asarray(line.get_ydata(), dtype=float) for line in ax.get_lines()]
        curves = [curve for curve in curves if len(curve) > 2]
        if curves and not any(np.nan_to_num(curve).any() for curve in curves):
            found.append(f"{name}: all curves are zero.")
        low, high = ax.get_ylim()
        if ax.get_yscale() == "log" and high > LARGEST_RATIO * low:
            found.append(f"{name}: the axis reaches from {high:.0e} down to {low:.0e}.")
    return found


def main(example: str) -> None:
    """Run it, then look at every figure that it leaves open."""
    runpy.run_path(example, run_name="__main__")
    import matplotlib.pyplot as plt

    found = [line for number in plt.get_fignums() for line in complaints(plt.figure(number))]
    if found:
        sys.exit("\n".join(found))


if __name__ == "__main__":
    main(sys.argv[1])
