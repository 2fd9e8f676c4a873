"""Laws and guards as text: complete, with the effects' terms and the names of the channels."""

import numpy as np
import pytest
from effect_fits import fit_by_hand

from swsysid import EffectRegressor, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._effect_model.equations import guards_with_effects, laws_with_effects
from swsysid.effects import (
    AsymmetricFriction,
    Backlash,
    Bias,
    BoucWen,
    ClockLag,
    CoulombFriction,
    DahlFriction,
    DeadZone,
    Delay,
    Drift,
    Effect,
    EndStop,
    ExtraMode,
    Feedthrough,
    GainChange,
    GuardHysteresis,
    Hill,
    Hysteresis,
    InputCoupling,
    InputGain,
    Lag,
    LoadFriction,
    LuGreFriction,
    Overflow,
    PeriodicForcing,
    PlacedEffect,
    Polynomial,
    PowerLaw,
    QuadraticDrag,
    Quantisation,
    RateLimit,
    Reset,
    Ripple,
    Saturation,
    SensorOffset,
    SoftSaturation,
    Stick,
    StribeckFriction,
    TimeInterval,
    TransportDelay,
    Trigonometric,
    UnknownFunction,
    UnmeasuredDisturbance,
    all_effects,
    special_effects,
)
from swsysid.effects._guards import Guard

NAMES = ["x", "v", "u", "load"]
# an effect, its place and nonlinear parameters, and its columns as terms
COLUMNS = [
    (Bias(), "constant", (), ["1"]),
    (CoulombFriction(), 1, (), ["-sign(v)"]),
    (QuadraticDrag(), 1, (), ["-v |v|"]),
    (InputCoupling(), 3, (), ["load"]),
    (Drift(), "level", (), ["t"]),
    (Drift(), 0, (), ["t x"]),
    (TimeInterval(), 0, (2.5, 4.0), ["x [2.5 < t < 4]"]),
    (TimeInterval(ends=False), "level", (2.5,), ["[2.5 < t]"]),
    (Polynomial(), (0, 0, 1), (), ["x^2 v"]),
    (DeadZone(), 2, (0.5,), ["(u - clip(u, -0.5, 0.5))"]),
    (Saturation(), 2, (0.5,), ["clip(u, -0.5, 0.5)"]),
    (PowerLaw(), 2, (1.5,), ["sign(u) |u|^1.5"]),
    (Delay(), 2, (0.12,), ["u(t - 0.12)"]),
    (Lag(), 2, (0.3,), ["lag(u, 0.3)"]),
    (TransportDelay(), (2, 3), (0.4,), ["transport_delay(u by load, 0.4)"]),
    (Backlash(), 2, (0.2,), ["play(u, 0.2)"]),
    (Overflow(), 0, (1.25,), ["-max(x - 1.25, 0)"]),
    (GainChange(), 2, (0.5,), ["(u - clip(u, -0.5, 0.5))"]),
    (PeriodicForcing(), "time", (1.0,), ["sin(6.283 t)", "cos(6.283 t)"]),
    (Trigonometric(), 0, (2.0,), ["sin(2 x)", "cos(2 x)"]),
    (StribeckFriction(), 1, (0.1,), ["-sign(v)", "-sign(v) exp(-(v / 0.1)^2)"]),
    (AsymmetricFriction(), 1, (), ["-[v > 0]", "[v < 0]", "-max(v, 0)"]),
    (LoadFriction(), (1, 3), (), ["-|load| sign(v)"]),
    (InputGain(), (0, 2), (), ["|u| x"]),
    (Hysteresis(), (0, 2), (), ["-|u| x"]),
    (SoftSaturation(), 2, (0.5,), ["(u / (1 + |u| / 0.5))"]),
    (Hill(), 2, (0.5,), ["(u^2 / (0.5^2 + u^2))"]),
    (Ripple(), 0, (np.pi,), ["sin(2 x)", "cos(2 x)"]),
    (DahlFriction(), 1, (0.02,), ["-dahl(v, 0.02)"]),
    (
        LuGreFriction(),
        1,
        (0.02, 0.1, 0.5),
        ["-lugre(v, 0.02, 0.1, 0.5)", "-lugre_rate(v, 0.02, 0.1, 0.5)"],
    ),
    (BoucWen(), 1, (0.02, 2.0, 0.5), ["-bouc_wen(v, 0.02, 2, 0.5)"]),
]
GUARD = Guard(terms=((0,),), weights=(-1.0,), upper_mode=1)
STATEMENTS = [
    (SensorOffset(), 0, 0, (0.05,), "x is recorded with an offset of 0.05"),
    (Feedthrough(), (0, 2), 0, (-0.05,), "x is recorded with -0.05 u added, which no law has"),
    (ClockLag(), 1, 1, (0.02,), "v is recorded late, by 0.02"),
    (Quantisation(), 0, 0, (0.25,), "x is recorded in steps of 0.25"),
    (
        GuardHysteresis(),
        GUARD,
        1,
        (-21.9, -20.4),
        "mode 1 from x < 20.4 on, mode 0 from x > 21.9 on",
    ),
    (
        UnmeasuredDisturbance(),
        "time",
        1,
        (0.4, 1.5),
        "a force of size 0.4 that nobody measured acts on v and is forgotten after 1.5",
    ),
    (Stick(), 0, 0, (0.4,), "x stands still while its law says less than 0.4 in size"),
    (RateLimit(), 0, 0, (0.4,), "x moves no faster than 0.4, whatever its law says"),
    (EndStop(), (0, "highest"), 0, (1.3,), "x is held at 1.3: it does not get above"),
    (Reset(), (0, 1), 1, (-0.8,), "v is multiplied by -0.8 where mode 0 turns into mode 1"),
]


def evaluated(term):
    """The value of a term at x = 1.5, v = -0.05, u = 0.8, load = 2, t = 3."""
    values = {"x": 1.5, "v": -0.05, "u": 0.8, "load": 2.0, "t": 3.0}
    functions = {name: getattr(np, name) for name in ("sign", "clip", "sin", "cos", "exp")}
    text = term.removeprefix("-").replace("^", "**").replace(" ** ", "**")
    for name in ("v", "u", "load"):
        text = text.replace(f"|{name}|", f"abs({name})")
    text = text.replace("[", "(").replace("]", ")")
    text = "*".join(_factors(text))
    value = float(eval(text, {"max": max, "abs": abs}, values | functions))
    return -value if term.startswith("-") else value


def _factors(text):
    """Split at blanks outside brackets, and between a number and a name inside them."""
    depth, parts = 0, [""]
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        parts = [*parts, ""] if letter == " " and depth == 0 else [*parts[:-1], parts[-1] + letter]
    return [part.replace("6.283 t", "6.283 * t").replace("2 x", "2 * x") for part in parts]


@pytest.mark.parametrize(("effect", "place", "theta", "terms"), COLUMNS)
def test_columns_as_terms_have_the_values_of_the_columns(effect, place, theta, terms):
    assert list(effect.column_names(effect.label(place, NAMES), *theta)) == terms
    if "order" in effect.needs:  # it remembers, and one row says nothing
        return
    records = make_records(
        np.array([[1.5, -0.05, 0.8]]), 2, t=[3.0], signals=[[2.0]], names=NAMES[:3]
    )
    (values,) = effect.columns(records, place, *theta)
    # four digits of the parameters are printed
    assert [evaluated(term) for term in terms] == pytest.approx(values, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize("effect, theta", [(TimeInterval(), (2.5, 4.0)), (Drift(), ())])
def test_a_channel_of_the_name_of_the_constant_is_told_apart(effect, theta):
    """A tank whose level is logged as `level`, or as `level_m`."""
    written = [
        effect.column_names(effect.label(place, [name]), *theta)[0]
        for name, place in (("level", "level"), ("level", 0), ("level_m", 0))
    ]
    constant = written[0].removeprefix("t")
    of_channels = ["(level)", "level_m"]
    assert written[0] in ("[2.5 < t < 4]", "t")
    assert written[1:] == [f"{one} {constant}" if constant else f"t {one}" for one in of_channels]


def test_every_effect_of_the_library_has_a_text():
    told = {effect.kind for effect, *_ in [*COLUMNS, *STATEMENTS]} | {ExtraMode.kind}
    shape = UnknownFunction((0, 1), ((0.0,), (1.0,), (2.0,)), of_product=True)
    values = np.array([0.1, 0.2, 0.3])
    assert shape.written(shape.label((0, 1), NAMES), (), values) == [(1.0, "f(x v)")]
    told |= {shape.kind}
    assert told == {effect.kind for effect in [*all_effects(), *special_effects()]}


@pytest.mark.parametrize(("effect", "place", "target", "theta", "text"), STATEMENTS)
def test_effects_without_columns_say_what_they_do(effect, place, target, theta, text):
    assert effect.statement(place, NAMES, target, *theta).startswith(text)


def test_an_effect_of_a_user_is_printed_by_its_kind():
    class EndStop(Effect):
        kind = "end_stop"
        terms = ("stiffness", "damping")

    names = EndStop().column_names("x", 0.25)
    assert names == ("end_stop_stiffness(x, 0.25)", "end_stop_damping(x, 0.25)")


def test_the_laws_hold_the_effects_with_the_names_of_the_channels():
    rng = np.random.default_rng(0)
    v = rng.uniform(-1, 1, (400, 1))
    friction = PlacedEffect(CoulombFriction(), place=0, target=0)
    own = PlacedEffect(QuadraticDrag(), place=0, target=0, mode=None)
    rate = -2.0 * v - 0.3 * np.sign(v) - 0.7 * v * np.abs(v)
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(v, columns=["speed"])
    model = EffectRegressor(SwitchingSystemRegressor(n_modes=1), [friction, own]).fit(frame, rate)
    (law,) = model.equations(precision=2)
    assert law == "mode 0: speed' = -2.00 speed - 0.30 sign(speed) - 0.70 speed |speed|"
    (latex,) = model.equations(precision=1, format="latex")
    assert r"0.3 \operatorname{sign}(speed)" in latex
    assert model.surface_equations() == []


def test_the_guards_hold_memory_and_jumps():
    """Guards that remember take the place of the surface, jumps come after it."""
    guard = PlacedEffect(GuardHysteresis(), GUARD, 1, theta=(-21.9, -20.4))
    reset = PlacedEffect(Reset(), (0, 1), 1, theta=(-0.8,))
    sides = {"guard": lambda X: X[:, 0]}
    laws = [[[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 0.0]], [[0.0, 1.0, 0.0, 0.0], [0.0] * 4]]
    plain = fit_by_hand(laws, [reset], [[]], **sides)
    lines = guards_with_effects(plain, NAMES, 3, "text")
    assert lines[0].startswith("f0(x, v, u) = ") and "(mode " in lines[0]
    assert lines[1].startswith("v is multiplied by -0.8")
    (told,) = guards_with_effects(fit_by_hand(laws, [guard], [[]], **sides), NAMES, 3, "text")
    assert told.startswith("mode 1 from x < 20.4 on")
    (latex,) = guards_with_effects(
        fit_by_hand(laws, [guard], [[]], **sides), ["x_m", *NAMES[1:]], 3, "latex"
    )
    assert r"\text{mode 1 from x\_m < 20.4 on" in latex
    assert not any("multiplied" in line for line in laws_with_effects(plain, NAMES, 3, "text"))
