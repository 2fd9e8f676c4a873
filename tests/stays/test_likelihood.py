"""The likelihood of recordings is that of a plain sum of squares, with dense matrices.

Laws are affine, so that matrix exponentials say where intervals lead; every residual is written
down one by one and differentiated by differences.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.linalg import expm

from swsysid._data.features import FeatureMap
from swsysid._data.recordings import Record
from swsysid._stays.descent import Reached
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.nodes import Nodes
from swsysid._stays.polynomial_laws import laws_of
from swsysid._stays.recordings import Recordings
from swsysid._stays.resets import Resets
from swsysid._stays.samples import Samples, intervals_of, misfits, modes_of, named_as
from swsysid._stays.settings import LIMITS
from swsysid._stays.stays import Stays

NOISE = np.array([0.05, 0.02])
COEF = np.array([
    [[0.0, 0.0, 1.0, 0.0], [0.2, -1.0, -0.3, 1.0]],
    [[0.1, 0.0, 1.0, 0.3], [-0.1, -4.0, -0.2, 0.5]],
])  # fmt: skip
SURFACE = np.array([[-0.1, 1.0, 0.2, 0.3]])  # of 1, x, v, u


class Told(Stays):
    """Stays whose switches have a transition each: 0 into mode 1, 1 out of it."""

    @property
    def transitions(self):
        return np.where(self.modes[1:] == 1, 0, 1)


@dataclass
class Case:
    """Two recordings of different lengths, uneven times, a lost value and one of other noise."""

    even: bool = True
    affine: bool = False  # laws that know to be affine: slopes of all steps are one
    with_guards: bool = False
    with_resets: bool = False
    far: float = 0.0  # by which states miss the surface, further
    walk: tuple = (0.0, 0.0)  # what a random walk adds in an interval

    def __post_init__(self):
        rng, self.known = np.random.default_rng(5), {}
        self.times = [np.linspace(0.0, 2.2, 23), np.linspace(1.0, 2.6, 17)]
        if not self.even:  # no two steps last equally long
            self.times = [t + 0.02 * rng.uniform(-1.0, 1.0, len(t)) for t in self.times]
        self.u = [np.column_stack([np.sin(3.0 * t)]) for t in self.times]
        self.stays = [([0, 1, 0], [0.53, 1.71]), ([1, 0], [1.92])]
        x = [np.column_stack([np.cos(2.0 * t), -np.sin(2.0 * t)]) for t in self.times]
        self.states = np.concatenate(x) + 0.05 * rng.standard_normal((40, 2)) + self.far
        self.y = [own + 0.1 * rng.standard_normal(own.shape) for own in x]
        self.sizes = np.ones((23, 2, 2))
        if not self.affine:  # where all is measured alike, all blocks are one
            self.y[0][4, 1] = self.y[1][16, 0] = np.nan
            self.sizes[3, 1] = 2.0, 0.5
        records = [Record(*own) for own in zip(self.times, self.y, self.u, strict=True)]
        walk = np.array(self.walk)
        recordings = replace(Recordings.of(records), sizes=self.sizes, walk=walk)
        kind = Told if self.with_resets else Stays
        stays = [kind(np.array(modes), np.array(instants)) for modes, instants in self.stays]
        free = COEF != 0.0
        free[0, 0, 2] = False
        self.laws = Laws(COEF, affine, np.ones(2), free)
        if self.affine:
            terms = FeatureMap(
                1, np.column_stack([self.states, np.concatenate(self.u)]), list("xvu")
            )
            self.laws = laws_of(COEF, terms, np.ones(2), free)
        self.guards = self.resets = None
        if self.with_guards:
            fixed = np.array([[True, False, True, True]])
            self.guards = Guards(SURFACE, affine, np.ones(3), np.array([[-1], [1]]), fixed)
        if self.with_resets:
            maps = np.array([[[0.1, 1.0, 0.0], [0.0, 0.2, -0.5]], [[0.0, 1.0, 0.0], [0.3, 0.0, 1]]])
            told = np.zeros(maps.shape, dtype=bool)
            told[0, 1, 2] = told[1, 1, 0] = True  # one switch tells two numbers, at most
            self.resets = Resets(maps, told)
        nodes = Nodes(recordings, stays)
        self.estimate = Estimate(self.laws, nodes, self.states, self.guards, self.resets)

    @property
    def start(self):
        """All unknowns, in the order of their steps."""
        parts = [self.laws.coef[self.laws.free], self.states.ravel()]
        parts += [np.array(instants) for _, instants in self.stays]
        parts += [one.coef[one.free] for one in [self.guards] if one is not None]
        parts += [one.maps[one.free] for one in [self.resets] if one is not None]
        return np.concatenate(parts)

    def residuals(self, unknowns, objective, rates=None):
        """Residuals of each recording, one by one, and the rates at which surfaces are crossed."""
        n_laws, n_guards = self.laws.n_free, 0 if self.guards is None else 3
        of_laws, states, instants, of_guards, of_resets = np.split(
            unknowns, np.cumsum([n_laws, 80, 3, n_guards])
        )
        coef, surface = COEF.copy(), SURFACE.copy()
        coef[self.laws.free] = of_laws
        if self.with_guards:
            surface[self.guards.free] = of_guards
        if self.with_resets:
            maps = self.resets.maps.copy()
            maps[self.resets.free] = of_resets
        interval = np.median(np.concatenate([np.diff(t) for t in self.times]))
        states, begin, switch, found, seen = states.reshape(-1, 2), 0, 0, [], []
        for number, (t, y, u) in enumerate(zip(self.times, self.y, self.u, strict=True)):
            modes, own = (
                self.stays[number][0],
                instants[switch : switch + len(self.stays[number][1])],
            )
            x, residuals = states[begin : begin + len(t)], []
            of_samples = (y - x) / (objective.noise * self.sizes[: len(t), number])
            residuals.append(of_samples[np.isfinite(y)])
            for k in range(len(t) - 1):
                h, slope = t[k + 1] - t[k], (u[k + 1] - u[k]) / (t[k + 1] - t[k])
                mode = modes[np.searchsorted(own, t[k])]
                end, input_, last = x[k], u[k], t[k]
                for place in np.flatnonzero((own >= t[k]) & (own < t[k + 1])):
                    end, input_ = flown(coef[mode], end, input_, slope, own[place] - last)
                    last = own[place]
                    if self.with_guards:
                        rate = np.concatenate([velocity(coef[mode], end, input_), slope])
                        seen.append(abs(surface[0, 1:] @ rate))
                        size = seen[-1] if rates is None else rates[len(seen) - 1]
                        f = surface[0] @ np.concatenate([[1.0], end, input_])
                        residuals.append(np.array([f / size / objective.guard_time]))
                    mode = modes[place + 1]
                    if self.with_resets:
                        end = maps[0 if mode == 1 else 1] @ np.append(1.0, end)
                end, _ = flown(coef[mode], end, input_, slope, t[k + 1] - last)
                loose = np.hypot(objective.tie, np.array(self.walk) / objective.noise)
                weight = 1.0 / (loose * np.sqrt(h / interval))
                residuals.append((x[k + 1] - end) / objective.noise * weight)
            found.append(np.concatenate(residuals))
            begin, switch = begin + len(t), switch + len(own)
        return found, np.array(seen)

    def dense(self, objective):
        """All residuals, and their derivatives by differences; made once."""
        if objective.tie not in self.known:
            self.known[objective.tie] = self._dense(objective)
        return self.known[objective.tie]

    def _dense(self, objective):
        rates = self.residuals(self.start, objective)[1]  # at the estimate, as Gauss and Newton do

        def at(move):
            return np.concatenate(self.residuals(self.start + move, objective, rates)[0])

        size = 1e-5 * np.eye(len(self.start))
        return at(0.0), np.stack([(at(one) - at(-one)) / 2e-5 for one in size], axis=1)


def affine(X):
    return np.column_stack([np.ones(len(X)), X])


def velocity(coef, x, u):
    return coef @ np.concatenate([[1.0], x, u])


def flown(coef, x, u, slope, duration):
    """State and input after a time, by the exponential of one matrix."""
    n, m = len(x), len(u)
    matrix = np.zeros((n + m + 1, n + m + 1))
    matrix[:n, :n], matrix[:n, n:-1], matrix[:n, -1] = coef[:, 1:3], coef[:, 3:], coef[:, 0]
    matrix[n:-1, -1] = slope
    end = expm(matrix * duration) @ np.concatenate([x, u, [1.0]])
    return end[:n], end[n:-1]


CASES = {
    "even": Case(),
    "affine": Case(affine=True),
    "uneven": Case(even=False),
    "surface": Case(with_guards=True),
    "resets": Case(even=False, with_guards=True, with_resets=True),
    "walk": Case(affine=True, with_guards=True, walk=(0.004, 0.03)),
}


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]


@pytest.mark.parametrize("tie", [0.3, 1e-5])
def test_equations_are_those_of_dense_least_squares(case, tie):
    """Value and gradient by all unknowns, of loose ties and of tight ones."""
    objective = Objective(NOISE, tie, 5.0)  # no crossing is far off its surface
    left, slopes = case.dense(objective)
    equations = objective.normal_equations(case.estimate)
    value = 0.5 * left @ left
    # Runge and Kutta's steps are as exact as the fourth power of a twentieth
    assert equations.value == pytest.approx(value, rel=1e-4)
    assert objective.value(case.estimate) == pytest.approx(value, rel=1e-4)
    gradient = -slopes.T @ left
    size = np.sqrt(np.square(slopes).sum(axis=0))
    np.testing.assert_allclose(
        equations.negative_gradient / size, gradient / size, atol=2e-4 * np.sqrt(2.0 * value)
    )


def without(matrix, right, corner, others):
    """Schur complement of the corner, and what is right of it."""
    border = np.linalg.solve(matrix[np.ix_(others, others)], matrix[np.ix_(others, corner)])
    schur = matrix[np.ix_(corner, corner)] - matrix[np.ix_(corner, others)] @ border
    return schur, right[corner] - border.T @ right[others]


@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_a_damped_step_and_its_promise_are_those_of_dense_matrices(case, damping):
    objective = Objective(NOISE, 0.3, 5.0)
    left, slopes = case.dense(objective)
    right, n_laws = -slopes.T @ left, case.laws.n_free
    every = np.arange(len(right))
    laws, states, instants, others = np.split(every, [n_laws, n_laws + 80, n_laws + 83])
    corner, inner = np.append(laws, others), np.append(states, instants)
    matrix, held = slopes.T @ slopes, np.zeros(len(right))
    # half a nat for an interval holds an instant, and belongs to what is promised
    hold = case.estimate.nodes.recordings.interval**-2.0
    matrix[instants, instants] += hold
    held[states], held[instants] = damping * np.tile(NOISE**-2.0, 40), damping * hold
    # laws, surfaces and resets are damped by what is known of them without nodes and instants
    held[corner] = damping * np.diag(without(matrix + np.diag(held), right, corner, inner)[0])
    size = np.sqrt(np.diag(np.linalg.inv(matrix + np.diag(held))))
    expected = np.linalg.solve(matrix + np.diag(held), right)
    step, promised = objective.normal_equations(case.estimate).step(damping)
    np.testing.assert_allclose(step / size, expected / size, atol=2e-3 * max(abs(expected / size)))
    gained = right @ expected - 0.5 * expected @ matrix @ expected
    assert promised == pytest.approx(gained, rel=2e-3)


def test_what_is_known_of_unknowns_is_the_inverse_of_the_dense_matrix(case):
    objective = Objective(NOISE, 0.3, 5.0)
    left, slopes = case.dense(objective)
    matrix, right, n_laws = slopes.T @ slopes, -slopes.T @ left, case.laws.n_free
    laws, states, instants, others = np.split(
        np.arange(len(right)), [n_laws, n_laws + 80, n_laws + 83]
    )
    equations = objective.normal_equations(case.estimate)
    arrow, right_of_corner = equations.reduced()
    schur, pull = without(matrix, right, np.append(laws, others), np.append(states, instants))
    unit = np.sqrt(np.diag(schur))
    scale = unit * unit[:, None]
    # a crossing that misses by .2 of its unit weighs a thousandth less
    np.testing.assert_allclose(arrow.schur / scale, schur / scale, atol=3e-3)
    np.testing.assert_allclose(
        arrow.pull(right_of_corner) / unit, pull / unit, rtol=3e-3, atol=0.01
    )
    covariance, inverse = equations.covariance(), np.linalg.inv(matrix)
    variances, guards = np.diag(inverse), others[: 3 if case.with_guards else 0]
    for found, own in ((covariance.of_laws, laws), (covariance.of_guards, guards),
                       (covariance.of_shared, np.append(laws, others))):  # fmt: skip
        scale = np.sqrt(variances[own] * variances[own][:, None])
        np.testing.assert_allclose(found / scale, inverse[np.ix_(own, own)] / scale, atol=5e-3)
    np.testing.assert_allclose(covariance.variances_of_instants, variances[instants], rtol=5e-3)
    assert not covariance.untold_laws.any()


def test_crossings_far_from_their_surface_count_less():
    """Half a square near it, and as far beyond as a distance times three, less nine."""
    case = Case(with_guards=True, far=0.4)
    objective = Objective(NOISE, 0.3, 0.02)
    parts, rates = case.residuals(case.start, objective)
    near = Objective(NOISE, 0.3, 1e9)  # without the crossings
    expected = 0.5 * np.array([own @ own for own in case.residuals(case.start, near)[0]])
    misses = case.estimate.guards.misses(case.estimate.crossings).times / 0.02
    assert (abs(misses) > 3.0).all() and len(rates) == 3
    far = LIMITS.far_miss * (np.hypot(LIMITS.far_miss, misses) - LIMITS.far_miss)
    expected += [far[:2].sum(), far[2]]
    found = objective.by_recording(case.estimate)
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    equations = objective.normal_equations(case.estimate)
    assert equations.value == pytest.approx(found.sum(), rel=1e-10)
    # the slope of that by coefficients of the surface, at the rates there are
    own = slice(case.laws.n_free + 83, None)

    def value(move):
        f = case.estimate.guards.moved(move).coef @ affine(case.estimate.crossings.columns[:, :3]).T
        return LIMITS.far_miss * np.hypot(LIMITS.far_miss, f / rates / 0.02).sum()

    pulls = [(value(move) - value(-move)) / 2e-6 for move in 1e-6 * np.eye(3)]
    np.testing.assert_allclose(-equations.negative_gradient[own], pulls, rtol=1e-4)


def test_names_of_modes_mean_nothing():
    """Value by recording, crossings and what is looked up at samples, modes renamed."""
    case = Case(with_guards=True)
    objective, estimate = Objective(NOISE, 0.3, 0.1), case.estimate
    other = estimate.renamed(np.array([1, 0]))
    np.testing.assert_array_equal(other.laws.coef, COEF[::-1])
    np.testing.assert_array_equal(other.guards.mode_book, [[1], [-1]])
    found, expected = objective.by_recording(other), objective.by_recording(estimate)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    np.testing.assert_array_equal(modes_of(other), 1 - modes_of(estimate))
    same = named_as(estimate, other)
    np.testing.assert_array_equal(modes_of(same), modes_of(estimate))
    np.testing.assert_array_equal(same.laws.coef, COEF)
    assert named_as(estimate, estimate) is estimate
    alone = estimate.only(np.array([1]))
    assert named_as(estimate, alone) is estimate and len(alone.laws.coef) == 1
    assert all(one.modes.tolist() == [0] for one in alone.nodes.stays)


def test_what_an_estimate_says_at_its_samples():
    case = Case(even=False)
    estimate, samples = case.estimate, Samples.of(case.estimate)
    u, modes = np.concatenate(case.u), []
    for t, (names, instants) in zip(case.times, case.stays, strict=True):
        modes += [names[int((np.array(instants) < one).sum())] for one in t]
    assert samples.modes.tolist() == modes == modes_of(estimate).tolist()
    np.testing.assert_array_equal(samples.columns, np.hstack([case.states, u]))
    expected = [velocity(COEF[m], x, v) for m, x, v in zip(modes, case.states, u, strict=True)]
    np.testing.assert_allclose(samples.velocities, expected, rtol=1e-12)
    slopes = [np.diff(v[:, 0]) / np.diff(t) for t, v in zip(case.times, case.u, strict=True)]
    # a row ends no interval but the last; the padding of the shorter recording has no slope
    first, second = (samples.rates[:23, 2], samples.rates[23:, 2])
    np.testing.assert_allclose(first[:-1], slopes[0], rtol=1e-9)
    np.testing.assert_allclose(second[:-1], slopes[1], rtol=1e-9)
    assert first[-1] == first[-2] and second[-1] == 0.0
    np.testing.assert_allclose(samples.spread, samples.columns.std(axis=0))
    ends = intervals_of(estimate)
    assert ends[:22, 0].tolist() == modes[1:23] and ends[:16, 1].tolist() == modes[24:]
    assert (ends[16:, 1] == modes[-1]).all()
    left = misfits(estimate)
    for k, (y, begin) in enumerate(zip(case.y, (0, 23), strict=True)):
        own = (y - case.states[begin : begin + len(y)]) / case.sizes[: len(y), k]
        np.testing.assert_allclose(left[: len(y), k], own, rtol=1e-12)


@pytest.mark.parametrize("tie", [0.05, 0.4, 2.0])
def test_states_are_worth_the_trace_of_the_smoother_of_a_random_walk(tie):
    traces = []
    for n in (300, 600):  # the ends of a walk are worth the same, however long it is
        walk = np.diff(np.eye(n), axis=0)
        traces.append(np.trace(np.linalg.inv(np.eye(n) + walk.T @ walk / tie**2)))
    told = Objective(NOISE, tie).n_states_told(Case().estimate.nodes)
    # 2 states of 2 recordings and 40 nodes
    assert (told / 2.0 - 2.0) / 40.0 == pytest.approx((traces[1] - traces[0]) / 300, rel=1e-6)


def test_instants_are_put_where_states_are_on_the_surface():
    """x' = 1 and then 2, the surface x = .52; at .2 the state is said to be as the clock."""
    t = 0.1 * np.arange(11)
    coef = np.array([[[1.0, 0.0]], [[2.0, 0.0]]])
    laws = Laws(coef, affine, np.ones(1), np.ones(coef.shape, dtype=bool))
    surface = np.array([[-0.52, 1.0]])
    book = np.array([[-1], [1]])
    guards = Guards(surface, affine, np.ones(1), book, np.array([[True, False]]))
    recordings = Recordings.of([Record(t, t[:, None], np.empty((11, 0)))])
    for begin, expected in ((0.45, 0.52), (0.51, 0.51), (0.22, 0.42)):
        nodes = Nodes(recordings, [Stays(np.array([0, 1]), np.array([begin]))])
        estimate = Estimate(laws, nodes, t[:, None].copy(), guards)
        # within a quarter of an interval it is on it; two intervals are the farthest move
        assert estimate.snapped().nodes.instants.item() == pytest.approx(expected, abs=1e-9)
        assert (estimate.snapped() is estimate) == (begin == expected)
    assert replace(estimate, guards=None).snapped().nodes.instants.item() == 0.22


def test_a_node_that_an_instant_passes_goes_with_the_flow():
    """Where the mode of a node changes, it is where its new law leads from the node before."""
    case = Case()
    step = np.zeros(len(case.start))
    instants = slice(case.laws.n_free + 80, case.laws.n_free + 83)
    # the first leaves .53 for .73, the second 1.71 for one twice an interval away at most
    step[instants] = 0.2, -0.5, 0.0
    moved = case.estimate.moved(step)
    interval = case.estimate.nodes.recordings.interval
    np.testing.assert_allclose(moved.nodes.instants, [0.73, 1.71 - 2.0 * interval, 1.92])
    passed = np.flatnonzero(moved.nodes.names != case.estimate.nodes.names)
    assert passed.tolist() == [6, 7, 16, 17]
    kept = np.setdiff1d(np.arange(40), passed)
    np.testing.assert_array_equal(moved.states[kept], case.states[kept])
    x, u, slopes = case.states.copy(), case.u[0], np.diff(case.u[0], axis=0) / 0.1
    for k, mode in ((6, 0), (7, 0), (16, 1), (17, 1)):
        if k == 16:  # the instant is at 1.51, just behind node 15
            x[k], v = flown(COEF[1], x[15], u[15], slopes[15], 1.71 - 2 * interval - 1.5)
            x[k] = flown(COEF[0], x[k], v, slopes[15], 1.6 - (1.71 - 2 * interval))[0]
        else:
            x[k] = flown(COEF[mode if k < 10 else 0], x[k - 1], u[k - 1], slopes[k - 1], 0.1)[0]
    np.testing.assert_allclose(moved.states[passed], x[passed], rtol=1e-5, atol=1e-7)


def test_an_estimate_is_judged_by_other_crossings_only_where_they_are_others():
    case = Case(with_guards=True)
    reached = Reached(case.estimate, Objective(NOISE, 0.3, 0.1), 7.0)
    assert reached.with_crossings(0.1) is reached  # its value is taken as it is
    for guard_time in (0.05, 0.3):
        other = reached.with_crossings(guard_time)
        objective = Objective(NOISE, 0.3, guard_time)
        assert other.value == pytest.approx(objective.value(case.estimate), rel=1e-12)
    without = Reached(CASES["even"].estimate, Objective(NOISE, 0.3, 0.1), 7.0)
    assert without.with_crossings(0.05) is without
