"""The result of the main job in words: equations with units, guards, held-out error, verdict."""

from __future__ import annotations

import numpy as np

from swsysid._cli.guard_words import higher_surface, regions
from swsysid._cli.job import JobResult
from swsysid._cli.physics_words import physics
from swsysid._cli.recording_words import recording_text, standard_errors
from swsysid._cli.samples import Samples
from swsysid._cli.settings import WORDING
from swsysid._effect_regressor import EffectRegressor
from swsysid._rendering.printing import linear_combination, ordinal
from swsysid._results import Array
from swsysid._surfaces.surface import solves_margin_program
from swsysid._verdict.terms import Terms


def render(result: JobResult) -> str:
    """The whole text, sections separated by empty lines."""
    samples, verdict = result.samples, result.verdict
    if result.found is not None:
        told = recording_text(result.found, samples, result.options)
    else:
        rolled = [] if verdict.free is None else [verdict.free.sentence(samples.time_unit)]
        told = "\n".join(part for part in [result.remark, *rolled] if part)
    said = [verdict.sentence, _stability(result), verdict.distrust(samples.time_unit)]
    parts = [_data(result), *_laws(result), _guards(result), told, verdict.table(samples.units)]
    return "\n\n".join(part for part in [*parts, "\n".join(filter(None, said))] if part)


def _stability(result: JobResult) -> str:
    """How sure the search in derivatives was that modes were delivered from."""
    if result.found is not None or result.model.n_modes_ == 1:
        return ""
    return f"The same answer came from {100 * result.declared.stability_:.0f} % of the starts."


def with_effects(model: EffectRegressor) -> str:
    """The complete laws and guards of a model with effects; "" if it has none."""
    if not model.effects_:
        return ""
    guards = model.surface_equations(precision=WORDING.precision)
    lines = ["model with effects", *model.equations(precision=WORDING.precision), *guards]
    return "\n    ".join(lines)


def _data(result: JobResult) -> str:
    samples = result.samples
    n_samples, n_groups = len(samples.X), len(np.unique(samples.groups))
    if result.found is not None and samples.recorded is not None:
        n_samples, n_groups = samples.recorded.n_samples, len(result.found.labels)
    lines = [described(samples, n_samples, n_groups), *preparation(samples)]
    if result.position_gain is not None:
        kept = "kept in" if 0 in result.terms.columns else "left out of"
        change = max(0.0, 100 * result.position_gain)
        lines.append(
            f"The position is {kept} the law: it lowers the error by {change:.1f} % "
            "(--position yes or no decides otherwise)."
        )
    if result.terms.waves:
        lines += _waves(result.terms, samples)
    return "\n".join(lines)


def _waves(terms: Terms, samples: Samples) -> list[str]:
    """Of which columns sines and cosines are taken, where units say so."""
    if not terms.angles and not terms.degrees:
        return []
    named = ", ".join(samples.names[k] for k in terms.turning)
    degrees = [samples.names[k] for k in terms.turning if k in terms.degrees]
    taken = f", with {', '.join(degrees)} in radians" if degrees else ""
    return [f"Sines and cosines are those of {named}{taken}."]


def described(samples: Samples, n_samples: int, n_groups: int) -> str:
    """How many samples there are, and of what."""
    columns = ", ".join(map(samples.with_unit, samples.names))
    every = f", every {ordinal(samples.decimate)} row" if samples.decimate > 1 else ""
    trajectories = "1 trajectory" if n_groups == 1 else f"{n_groups} trajectories"
    return f"{n_samples:,} samples of {trajectories}{every}: {columns}"


def preparation(samples: Samples) -> list[str]:
    """What was mended, masked and left out; how the states were smoothed, and their noise."""
    smoothing, t = samples.smoothing, samples.t
    if smoothing is None or t is None:
        return list(samples.remarks)
    if smoothing.window:
        step = float(np.median(np.diff(t))) / samples.decimate
        span = f"{smoothing.window * step:.2g} {samples.time_unit}".rstrip()
        how = f"Smoothed over windows of {smoothing.window} samples ({span})"
    elif smoothing.cutoff:
        rate = f" 1/{samples.time_unit}" if samples.time_unit not in ("", "s") else " Hz"
        how = f"Smoothed by a low-pass of {smoothing.cutoff:.3g}{rate}"
    else:
        how = "Not smoothed"
    sizes = ", ".join(
        f"{name} {size:.2g} {samples.unit(name)}".rstrip()
        for name, size in zip(samples.names, smoothing.noise, strict=False)
    )
    return [*samples.remarks, f"{how}; noise of one sample: {sizes}."]


def _laws(result: JobResult) -> list[str]:
    """One section for each mode, after the known equations."""
    model, samples = result.model, result.samples
    features = [str(name) for name in model.feature_names_out_]
    rates = samples.rate_names[: samples.n_known]
    known = zip(samples.names, rates, strict=False)
    sections = ["\n".join(f"known: the derivative of {name} is {rate}" for name, rate in known)]
    for mode, share in enumerate(_shares(result)):
        lines = [f"mode {mode} ({100 * share:.0f} % of the samples)"]
        for state in range(samples.n_known, len(samples.rate_names)):
            row = model.coef_[mode, state]
            rate = samples.rate_names[state]
            lines.append(f"    {rate} = {_sum(row, features)}{_unit_after(samples.unit(rate))}")
            if result.found is not None:
                lines += standard_errors(result.found, mode, state, features)
            if _is_driven(row, features, samples, state, result.modes == mode):
                lines.append(_balance(row, features, rate, samples))
        sections.append("\n".join(lines))
    return sections


def _shares(result: JobResult) -> Array:
    """Share of the samples in each mode."""
    modes = result.modes if result.found is None else result.found.identifier.modes_
    return np.bincount(modes, minlength=result.model.n_modes_) / len(modes)


def _is_driven(row, features, samples, state: int, members) -> bool:
    """True if one input drives a second-order system linearly, and moves the rate sensibly.

    A balance of forces is divided by the input's coefficient, so that of an input that does not
    matter it would be the noise of the fit blown up.
    """
    inputs = samples.names[2 * samples.n_known :]
    if not samples.n_known or len(inputs) != 1 or inputs[0] not in features or not members.any():
        return False
    moved = abs(row[features.index(inputs[0])]) * samples.X[members, -1].std()
    return bool(moved > WORDING.sensible * samples.Xdot[members, state].std())


def _balance(row, features, rate: str, samples) -> str:
    """The law of an accelerated body as a balance of forces: inertia q'' = input - rest.

    Its coefficients are mass and friction as a data sheet has them.
    """
    drive = samples.names[-1]
    driven = features.index(drive)
    scaled = -np.asarray(row) / row[driven]
    scaled[driven] = 0.0
    inertia = f"{1.0 / row[driven]:.{WORDING.precision}g}"
    body = f"    or {inertia} {rate} + ({_sum(scaled, features)}) = {drive}"
    return body + _unit_after(samples.unit(drive))


def _unit_after(unit: str) -> str:
    return f"   [{unit}]" if unit else ""


def _sum(row, features) -> str:
    return linear_combination(row, features, precision=WORDING.precision)


def _guards(result: JobResult) -> str:
    model, samples = result.model, result.samples
    if model.n_modes_ == 1:
        return ""
    if not result.comparison.constant:
        surface = model.surface_
        lines = regions(surface, samples) if solves_margin_program(surface) else []
        lines += physics(result.found, samples) if result.found is not None else []
        equations = model.surface_equations(precision=WORDING.precision)
        return "\n    ".join(["switching surface", *lines, *equations])
    always = int(model.surface_.predict(samples.X[:1])[0])
    shares = enumerate(_shares(result))
    listed = ", ".join(f"mode {mode} in {100 * share:.0f} %" for mode, share in shares)
    lines = [
        f"no switching surface: the fitted one gives mode {always} to every sample, although the "
        f"rates fit {listed} of them",
    ]
    if higher := higher_surface(result.modes, samples, result.options.surface_degree):
        return "\n    ".join([*lines, higher])
    lines += [
        "The same values of the columns are seen in different modes: these columns do not tell "
        "the modes apart.",
    ]
    told = result.memory
    if told:
        lines.append(f"The modes have a memory (hysteresis): {told}.")
    lines.append(
        "Run again with --automaton or --diagnose, which look for guards that remember, with "
        "another number of modes (--modes auto), or add the column that drives the switching to "
        "--inputs."
    )
    return "\n    ".join(lines)


def units_of_displays(samples: Samples) -> dict[str, str]:
    """Units by the names that displays use for rates and times."""
    rates = zip(samples.names, samples.rate_names, strict=False)
    named = {f"d/dt {name}": samples.unit(rate) for name, rate in rates}
    named["time"] = samples.time_unit
    return {**samples.units, **{name: unit for name, unit in named.items() if unit}}
