"""Student-t errors: weights, regression and likelihood that outliers cannot carry away."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

from swsysid._results import Array

__all__ = [
    "exact_below",
    "influence",
    "negative_log_likelihood",
    "robust_regression",
    "robust_weights",
    "scale_of",
    "t_cost",
]

_FREEDOM = 4.0
_REWEIGHTINGS, _ROUNDS = 8, 25


_EXACT = 1e-4  # of a velocity's spread: smaller errors are roundoff as far as effects go
_SMALLEST = 1e-150  # its square is still a number


def exact_below(targets: Array) -> Array:
    """Errors of each state below which an equation is exact, such as q' = v.

    An equation without noise would otherwise win or lose nats on the last digits of roundoff.
    """
    return np.maximum(_EXACT * targets.std(axis=0), _SMALLEST)


def robust_weights(residuals: Array, floor: Array | float = _SMALLEST) -> Array:
    """Weights of a Student-t regression for residuals of shape (n_samples, n_states).

    One weight a row: a row that is wrong in one state is not trusted in the others.
    """
    scale = 1.4826 * np.median(np.abs(residuals), axis=0)
    smallest = 1e-12 * np.abs(residuals).max(axis=0, initial=0.0)
    squares = np.mean((residuals / np.maximum(np.maximum(scale, smallest), floor)) ** 2, axis=1)
    return (_FREEDOM + 1.0) / (_FREEDOM + squares)


def influence(errors: Array) -> tuple[Array, Array]:
    """Weights w of a Student-t regression of one state, and the derivative of w e."""
    scale = max(1.4826 * float(np.median(np.abs(errors))), _SMALLEST)
    squares = (errors / scale) ** 2
    weight = (_FREEDOM + 1.0) / (_FREEDOM + squares)
    return weight, weight * (_FREEDOM - squares) / (_FREEDOM + squares)


def robust_regression(design: Array, target: Array, robust: bool = True) -> Array:
    """Student-t regression by iteratively reweighted least squares, or plain least squares."""
    size = np.linalg.norm(design, axis=0)
    size[size == 0.0] = 1.0
    scaled, weight = design / size, np.ones(len(target))
    for _ in range(_REWEIGHTINGS if robust else 1):
        root = np.sqrt(weight)
        coef = np.linalg.lstsq(root[:, None] * scaled, root * target, rcond=1e-10)[0]
        weight = robust_weights((target - scaled @ coef)[:, None])
    return coef / size


def scale_of(errors: Array, floor: Array | float = _SMALLEST) -> Array:
    """Most likely scale of Student-t errors in each state."""
    scale = np.maximum(np.median(np.abs(errors), axis=0), floor)
    for _ in range(_ROUNDS):
        weight = (_FREEDOM + 1.0) / (_FREEDOM + (errors / scale) ** 2)
        scale = np.maximum(np.sqrt(np.mean(weight * errors**2, axis=0)), floor)
    return scale


def t_cost(errors: Array, scale: Array) -> Array:
    """Negative log likelihood of Student-t errors, of the shape of `errors`."""
    constant = gammaln(_FREEDOM / 2) - gammaln((_FREEDOM + 1) / 2) + 0.5 * np.log(_FREEDOM * np.pi)
    tail = 0.5 * (_FREEDOM + 1.0) * np.log1p((errors / scale) ** 2 / _FREEDOM)
    return constant + np.log(scale) + tail


def negative_log_likelihood(errors: Array, floor: Array | float = _SMALLEST) -> Array:
    """Of Student-t errors of the most likely scale, in nats for each row and state."""
    return t_cost(errors, scale_of(errors, floor))
