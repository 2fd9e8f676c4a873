"""Rollouts side by side are those of a simulation, and their derivatives those of differences."""

from dataclasses import replace

import numpy as np

from swsysid._data.recordings import Record
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws, Maps
from swsysid._stays.recordings import Recordings
from swsysid._stays.rollouts import rolled_out
from swsysid._stays.sensitivities import RolledNodes, sensitivities
from swsysid.refinement import ParametricLibrary, StatedModel, StatedSurface

STARTS = ((2.0, 0.0), (0.0, -2.0), (-1.5, 1.0), (1.0, 2.0))


def oscillator(damping=(0.1, 0.5), surface=(0.0, -1.0, 0.0)):
    """Damping differs on the two sides of q = 0."""
    coef = [[[0.0, 1.0], [-1.0, -d]] for d in damping]
    return StatedModel(None, coef, states=["q", "v"], surface=StatedSurface([surface]))


def parts_of(model, free=False):
    """Laws and surfaces of a stated model, with all coefficients free or none."""
    n_columns, n_states = len(model.feature_map.names_in), model.coef_.shape[1]
    spread, form = np.ones(n_columns), model.surface.linear_form(n_columns)
    kind = Maps if model.discrete_time else Laws
    laws = kind(model.coef_, model.feature_map.at_rows, spread[:n_states], model.free & free)
    given = np.full(form.coef.shape, free)
    return laws, Guards(form.coef, form.features, spread, form.mode_book, given)


def grid_of(times, n_states, inputs=None, count=1, substeps=1, held=False):
    """Recordings at times, some steps between two of them."""
    u = np.empty((len(times), 0)) if inputs is None else inputs
    records = [Record(times, np.empty((len(times), 0)), u)] * count
    rough = [np.zeros((len(times), n_states))] * count
    grid = Recordings.of(records, rough, held=held).divided(substeps)
    return replace(grid, first_step=1.0)


def test_a_batch_rolls_out_as_the_simulation_does():
    """Switches cost no order: the error falls with the fourth power of the step, as between them.

    From 16 to 32 substeps it shrinks 13-fold or more (16 in the limit).
    """
    model, times = oscillator(), np.linspace(0.0, 12.0, 16)
    exact = np.stack([model.simulate(start, times, rtol=1e-12).x for start in STARTS], axis=1)
    errors = []
    for substeps in (16, 32):
        grid = grid_of(times, 2, count=len(STARTS), substeps=substeps)
        runs = rolled_out(*parts_of(model), grid, np.array(STARTS))
        states = np.stack([run.states[::substeps] for run in runs], axis=1)
        errors.append(np.abs(states - exact).max())
    assert errors[1] < 1e-6
    assert errors[0] / errors[1] > 13


def dry_friction():
    """Dry friction of 1 against a force."""
    library = ParametricLibrary({"1": lambda v: np.ones_like(v), "u": lambda u: u}, ["v", "u"])
    surface = StatedSurface([[0.0, 1.0, 0.0]])
    coef = [[[1.0, 1.0]], [[-1.0, 1.0]]]
    return StatedModel(library, coef, states=["v"], inputs=["u"], surface=surface)


def test_a_batch_sticks_and_slides_as_the_simulation_does():
    """The force exceeds dry friction at times; the mass rests in between."""
    model, times = dry_friction(), np.linspace(0.0, 10.0, 201)
    force = 1.5 * np.sin(times)[:, None]
    exact = model.simulate([0.3], times, force, input_hold="linear")
    assert any(event.kind == "sliding" for event in exact.events)
    grid = grid_of(times, 1, force, substeps=2)
    states = rolled_out(*parts_of(model), grid, np.array([[0.3]]))[0].states[::2]
    np.testing.assert_allclose(states, exact.x, atol=1e-4)
    at_rest = np.abs(exact.x[:, 0]) < 1e-9
    assert at_rest.sum() > 20
    np.testing.assert_allclose(states[at_rest], 0.0, atol=1e-9)


def test_held_inputs_jump_and_modes_with_them():
    """A square wave that is held pushes the mass over its friction, and lets it come to rest."""
    model, times = dry_friction(), np.linspace(0.0, 8.0, 41)
    force = np.where(times % 4.0 < 2.0, 1.6, -0.4)[:, None]
    exact = model.simulate([-0.5], times, force, input_hold="zero")
    grid = grid_of(times, 1, force, substeps=2, held=True)
    states = rolled_out(*parts_of(model), grid, np.array([[-0.5]]))[0].states[::2]
    np.testing.assert_allclose(states, exact.x, atol=1e-9)
    assert (np.abs(exact.x[:, 0]) < 1e-9).sum() > 5


def differences(model, starts, run, step=1e-6):
    """Of all states, by the starts of each rollout and all coefficients of laws and surfaces."""
    n_states, columns = starts.shape[1], []
    for k in range(n_states):
        moves = step * np.eye(n_states)[k]
        columns.append(run(model, starts + moves) - run(model, starts - moves))
    places = [(model.coef_, place) for place in zip(*np.nonzero(model.free), strict=True)]
    places += [(model.surface.coef_, place) for place in np.ndindex(model.surface.coef_.shape)]
    for array, place in places:
        both = []
        for sign in (1.0, -1.0):
            array[place] += sign * step
            both.append(run(model, starts))
            array[place] -= sign * step
        columns.append(both[0] - both[1])
    return np.stack(columns, axis=-1) / (2.0 * step)


def check_derivatives(model, grid, starts, tolerance=2e-5):
    def run(model, starts):
        runs = rolled_out(*parts_of(model), grid, starts)
        return np.concatenate([one.states for one in runs])

    laws, guards = parts_of(model, free=True)
    nodes = RolledNodes(grid, rolled_out(laws, guards, grid, starts))
    found = sensitivities(laws, guards, nodes)
    expected = differences(model, starts, run)
    assert found.shape == expected.shape
    for column, known in zip(np.moveaxis(found, -1, 0), np.moveaxis(expected, -1, 0), strict=True):
        np.testing.assert_allclose(column, known, atol=tolerance * max(1.0, np.abs(known).max()))
    return nodes


def test_derivatives_are_those_of_rollouts_that_are_integrated_again():
    """Long rollouts, switches included, against central differences."""
    model, times = oscillator((0.15, 0.4), (0.02, -1.0, 0.1)), np.arange(0.0, 12.0, 0.2)
    grid = grid_of(times, 2, count=len(STARTS), substeps=2)
    nodes = check_derivatives(model, grid, np.array(STARTS))
    assert len(nodes.at) > 10


def test_derivatives_of_slides_are_those_of_differences():
    """A state that rests on its surface moves with it; forces that are linear, and held ones."""
    times = np.linspace(0.0, 6.0, 61)
    force = 1.5 * np.sin(1.3 * times + 0.4)[:, None]
    for held in (False, True):
        model, grid = dry_friction(), grid_of(times, 1, force, held=held)
        nodes = check_derivatives(model, grid, np.array([[0.3]]), 1e-4)
        assert (nodes.modes >= 2).any()


def test_derivatives_in_discrete_time_are_those_of_differences():
    coef = [[[0.9, 0.2], [-0.2, 0.8]], [[0.7, 0.4], [-0.4, 0.7]]]
    surface = StatedSurface([[0.0, -1.0, 0.0]])
    model = StatedModel(None, coef, states=["a", "b"], surface=surface, discrete_time=True)
    starts = np.array(STARTS) + [0.1, 0.0]  # off the surface
    nodes = check_derivatives(model, grid_of(np.arange(12.0), 2, count=4), starts)
    assert len(np.unique(nodes.modes)) == 2
    exact = model.simulate(starts[0], np.arange(12.0)).x
    np.testing.assert_allclose(nodes.states[:12], exact, rtol=1e-12)


def test_derivatives_by_numbers_inside_of_features_are_those_of_differences():
    """x' = -a max(x - L, 0) + u with L unknown: the law bends at a level."""
    times, inputs = np.linspace(0.0, 5.0, 51), np.linspace(0.3, 0.9, 51)[:, None]
    grid, spread = grid_of(times, 1, inputs, substeps=2), np.ones(2)

    def laws_at(level, inside=()):
        def features(X):
            return np.column_stack([np.maximum(X[:, 0] - level, 0.0), X[:, 1]])

        return Laws(
            np.array([[[-0.8, 1.0]]]), features, spread[:1], np.ones((1, 1, 2), bool), inside=inside
        )

    nowhere = Guards(
        np.ones((1, 1)), lambda X: np.ones((len(X), 1)), spread, np.ones((1, 1), int),
        np.zeros((1, 1), bool),
    )  # fmt: skip

    def by_level(X):
        return np.column_stack([np.where(X[:, 0] > 0.7, -1.0, 0.0), np.zeros(len(X))])

    start = np.array([[1.5]])
    laws = laws_at(0.7, (by_level,))
    nodes = RolledNodes(grid, rolled_out(laws, nowhere, grid, start))
    found = sensitivities(laws, nowhere, nodes)[:, 0, -1]
    both = [rolled_out(laws_at(0.7 + move), nowhere, grid, start)[0] for move in (1e-6, -1e-6)]
    expected = (both[0].states - both[1].states)[:, 0] / 2e-6
    assert np.abs(expected).max() > 0.3
    np.testing.assert_allclose(found, expected, atol=1e-6)
