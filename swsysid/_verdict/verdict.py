"""`SwitchingVerdict`: whether modes are to be believed, as numbers and in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._rendering.printing import counted
from swsysid._results import Array
from swsysid._verdict.comparison import Comparison, Verdict
from swsysid._verdict.settings import JUDGING
from swsysid._verdict.words import (
    PYTHON,
    Words,
    change,
    distrust,
    held_out_text,
    root_mean_square,
    table,
)


@dataclass(frozen=True, repr=False)
class SwitchingVerdict:
    """What held-out recordings say of modes, beside smooth laws of a single one.

    Several modes always fit better than one law. Here both are identified once more without what
    is held out, and are rolled out over it.

    Attributes
    ----------
    kind : Verdict
        ``SWITCHES``, ``CHANCE``, ``SMOOTH``, ``ONE_MODE``, ``TOO_FEW``, ``USELESS``,
        ``UNREPEATED`` or ``HIDDEN``; its ``value`` says in words what that means.
    trusted : bool
        Whether the number of modes is to be believed: several are surely better than every smooth
        law that was tried, or one is as good as any and leaves nothing but noise.
    sentence : str
        The verdict in words, and what to do about it.
    improvement : float
        Part by which the modes lower the held-out error of the best smooth law.
    gain : float
        The same in standard errors over blocks of what is held out.
    errors : ndarray of shape (n_channels,)
        Root mean square errors of the modes on what is held out, in the units of the channels.
    errors_of_laws : dict of str to ndarray of shape (n_channels,)
        Those of the smooth laws of one mode, by their terms.
    best_law : str
        Terms of the best of them: of those that hardly differ, the fewest.
    noise : ndarray of shape (n_channels,) or None
        Noise of the channels; None where these are rates.
    channels : tuple of str
    n_modes : int
        Of the model.
    stands : bool
        Whether the model leaves nothing but noise where it is told when to switch.
    memory : str
        Where each of two modes begins, if a guard remembers; else "".
    remembers : bool
        Whether that is why the modes predict no better than one law: an automaton tells it.
    leaves_open : bool
        Whether neither modes nor a smooth law explain the recordings: what one law lacks is asked.
    free, free_of_held_out : FreeRollouts or None
        What free rollouts leave of the recordings, and of those held out by a model of the others.
    """

    comparison: Comparison
    n_modes: int
    asked: int | str
    channels: tuple[str, ...]
    terms: str  # of the laws of the model
    n_trained: int  # samples
    whole_recordings: bool  # are held out; else the last stretch of each
    switches: bool  # the model; else it is one smooth law
    stands: bool = False
    memory: str = ""
    free: FreeRollouts | None = None
    free_of_held_out: FreeRollouts | None = None
    given_up: int | None = None  # modes in whose place a model of one mode is delivered
    words: Words = PYTHON

    @property
    def kind(self) -> Verdict:
        """What the held-out samples say."""
        return self.comparison.verdict

    @property
    def trusted(self) -> bool:
        """Whether the number of modes is to be believed."""
        if self.switches:
            return self.kind is Verdict.SWITCHES
        return self.kind is Verdict.ONE_MODE and not self._lacks_something

    @property
    def remembers(self) -> bool:
        """Whether a guard that remembers is why the modes predict no better than one law."""
        no_better = self.comparison.improvement <= JUDGING.worth
        return self.switches and no_better and bool(self.memory)

    @property
    def leaves_open(self) -> bool:
        """Whether neither the modes nor a smooth law that was tried explains the recordings.

        Guards that remember, switches that nothing recorded tells, and modes that no curve imitates
        are explanations, to which something may be added.
        """
        if self.trusted and (not self.switches or self.improvement >= JUDGING.half):
            return False
        lacks = self.noise is None or self._lacks_something
        return lacks and not self.remembers and self.kind is not Verdict.HIDDEN

    @property
    def improvement(self) -> float:
        """Part by which the modes lower the held-out error of the best smooth law."""
        return self.comparison.improvement

    @property
    def gain(self) -> float:
        """The same in standard errors over blocks of what is held out."""
        return self.comparison.gain

    @property
    def errors(self) -> Array:
        """Root mean square errors of the modes on what is held out."""
        return root_mean_square(self.comparison.errors)

    @property
    def errors_of_laws(self) -> dict[str, Array]:
        """Those of the smooth laws, by their terms."""
        rivals = self.comparison.rivals
        return {str(rival.terms): root_mean_square(rival.errors) for rival in rivals}

    @property
    def best_law(self) -> str:
        """Terms of the best of them."""
        return str(self.comparison.best.terms)

    @property
    def noise(self) -> Array | None:
        """Of the channels, where these are measured states."""
        return self.comparison.noise

    def distrust(self, time_unit: str = "") -> str:
        """For how long the model is to be trusted by itself; "" where it always is."""
        return distrust((self.free, self.free_of_held_out), time_unit)

    def table(self, units: Mapping[str, str] = MappingProxyType({})) -> str:
        """The held-out errors beside the noise; `units` by the names of the channels."""
        names = [f"{one} [{units[one]}]" if units.get(one) else one for one in self.channels]
        head = held_out_text(self.comparison, self.n_trained, self.whole_recordings)
        is_other = self._n_compared > 1 or (self.switches and self.n_modes == 1)
        modes = self._compared if is_other else ""
        return "\n".join([head, *table(self.comparison, modes, names)])

    def __str__(self) -> str:
        told = "\n".join(one for one in (self.sentence, self.distrust()) if one)
        return f"{self.table()}\n\n{told}"

    def __repr__(self) -> str:
        trust = "trusted" if self.trusted else "not trusted"
        return f"SwitchingVerdict({self.kind.name}, n_modes={self.n_modes}, {trust})"

    # -- in words ----------------------------------------------------------------------------

    @property
    def sentence(self) -> str:
        """The verdict in words, and what to do about it."""
        comparison = self.comparison
        if self.given_up is not None:
            return self._no_switching(
                f"{self.given_up} modes were found, but one mode with {self.terms} terms predicts "
                "the held-out samples as well, and is delivered (error of the "
                f"{self._compared}: {change(comparison)})."
            )
        if self.switches:
            return self._of_modes()
        best = comparison.best
        if best is comparison.rivals[0]:
            return self._no_switching(
                "the model has one mode, and no smooth law with more terms is better."
            )
        lower = 1.0 - 1.0 / (1.0 - comparison.improvement)  # the best law's error, than the model's
        advice = "" if self._lacks_something else self._advice()
        return self._no_switching(
            f"the model has one mode. With {best.terms} terms its held-out error is "
            f"{100 * lower:.1f} % lower{advice}."
        )

    @property
    def _n_compared(self) -> int:
        """How many modes are compared with one: those that the training part has."""
        found = self.n_modes if self.given_up is None else self.given_up
        return found - len(self.comparison.untested)

    @property
    def _compared(self) -> str:
        return counted(self._n_compared, "mode")

    @property
    def _lacks_something(self) -> bool:
        """Whether no law of one mode leaves noise alone, or free rollouts refute the model.

        One that leaves noise alone of all recordings lacks nothing, whatever laws of a part of them
        leave of the others: instants of inputs between rows are estimated where a law is fitted.
        """
        holds = self.free is not None and self.free.holds
        strays = self.free is not None and not (holds or self.free.hangs_on_start)
        return strays or (self.comparison.lacks_something and not (holds and self.stands))

    def _no_switching(self, told: str) -> str:
        """What is `told` of one mode, which proves that nothing switches by leaving noise alone."""
        if not self._lacks_something:
            return f"No switching: {told}"
        where = " of the other samples" if self.comparison.noise_alone else ""
        return (
            f"Whether it switches is not shown: {told} That law leaves more than noise{where}: "
            f"{self._asking}try another library{self._if_memory(', or, ')}."
        )

    def _of_modes(self) -> str:
        comparison = self.comparison
        law = f"one mode with {comparison.best.terms} terms"
        judged = "rates" if comparison.noise is None else "states"
        sure = f"error {change(comparison)}, {comparison.gain:.1f} standard errors over blocks"
        if self.remembers:
            return self._of_memory()
        auto = self.words.auto
        other = "" if self.asked == "auto" else f"; or let the data say how many: {auto}"
        unsure = comparison.verdict in (Verdict.SMOOTH, Verdict.ONE_MODE)
        if unsure and comparison.lacks_something and self.stands:
            return self._of_surface(law, other)
        return self._of_held_out(law, judged, sure, other) + self._of_same_laws()

    def _of_same_laws(self) -> str:
        """Laws of one mode that are the modes, and are no rivals."""
        same = next((rival.terms for rival in self.comparison.rivals if rival.same), None)
        if same is None:
            return ""
        return (
            f" One mode with {same} terms is the same model, written as one law: the inputs tell "
            "the modes by a few values that they have, and between these nothing is known."
        )

    def _of_held_out(self, law: str, judged: str, sure: str, other: str) -> str:
        comparison, modes, words = self.comparison, self._compared, self.words
        return {
            Verdict.SWITCHES: (
                "Switching predicts the held-out samples clearly better than one mode: than the "
                f"best smooth law that was tried, {law} ({sure}).{self._beside_them}"
            ),
            Verdict.CHANCE: (
                f"Switching predicts the held-out samples better than {law}, which may be chance "
                f"({sure}). Record more trajectories{words.hold_out}.{self._in_their_place}"
            ),
            Verdict.SMOOTH: (
                "Switching does not predict the held-out samples clearly better than one mode: "
                f"{law} does as well (error of the {modes} {change(comparison)}). "
                f"{self._mistrust}, which may only follow a curve piece by piece"
                f"{self._smooth_advice()}{other}."
            ),
            Verdict.UNREPEATED: (
                f"Switching explains all that was recorded: told when to switch, {modes} "
                "leave nothing but noise, which no smooth law that was tried does. Laws of the "
                f"other samples alone do not repeat that on what is held out (error against {law} "
                f"{change(comparison)}): they are too few for every coefficient. Record more."
                f"{self._in_their_place}"
            ),
            Verdict.ONE_MODE: (
                "Switching does not predict the held-out samples clearly better than one mode "
                f"(error {change(comparison)}). {self._mistrust}: {self._asking}try another "
                f"library, keep one mode ({words.one_mode})"
                f"{self._if_memory(', or, ', 'try ')}{other}."
            ),
            Verdict.TOO_FEW: (
                "These data do not decide whether there is switching: the modes change "
                f"{counted(comparison.n_switches, 'time')} and {len(comparison.errors)} samples "
                f"are held out, where at least {JUDGING.fewest_switches} and "
                f"{JUDGING.fewest_rows} are needed. Record more."
            ),
            Verdict.USELESS: (
                f"The held-out error of the {modes} is no smaller than the spread of the "
                f"{judged}: these laws predict no better than the mean. Smooth the data more"
                f"{words.smooth}, add what drives the system to {words.inputs}, or try another "
                "library."
            ),
            Verdict.HIDDEN: self._of_hidden(law, other),
        }[comparison.verdict]

    @property
    def _mistrust(self) -> str:
        """Not to trust the modes, or only where the recordings tell nothing of them."""
        if self.comparison.lacks_something or not self.stands:
            return "Do not trust the modes"
        return (
            "Both leave nothing but noise; longer recordings, or less noise, would tell which is "
            "true. Do not trust the modes"
        )

    def _if_memory(self, before: str, verb: str = "") -> str:
        """What to try where modes may have memory; nothing of a model that has one."""
        if not self.words.memory:
            return ""
        return f"{before}if the modes may have memory or states jump, {verb}{self.words.memory}"

    def _of_memory(self) -> str:
        """A guard that remembers, as far as laws that leave only noise say so; or a mode lacks."""
        error, words = f"(error {change(self.comparison)})", self.words
        if self.stands:
            return (
                f"The guard remembers (hysteresis): {self.memory}. No surface tells that, and so "
                "the laws, which stand, predict the held-out samples no better than one mode "
                f"{error}. {words.again} {words.memory}, which finds such guards."
            )
        asked = self.asked == "auto"
        more = "" if asked else f"{words.auto}, and if that finds no more modes with "
        return (
            f"The guard may remember (hysteresis): {self.memory}. But the laws leave more than "
            "noise even where they are told when to switch, and predict the held-out samples no "
            f"better than one mode {error}. {words.again} {more}{words.memory}, which finds such "
            "guards."
        )

    def _of_hidden(self, law: str, other: str) -> str:
        """Modes that the samples tell, and nothing else."""
        if self.noise is None:
            return (
                "Switching does not predict the held-out samples clearly better than one mode, "
                "since the surface does not say which mode is active: the model uses the law of "
                f"one mode everywhere, and its error, against {law}, is "
                f"{change(self.comparison)}{other}."
            )
        return (
            f"Told when to switch, the {self._compared} leave "
            f"{100 * self.comparison.told_share:.0f} % of what the best smooth law that was tried "
            f"leaves, {law}: the modes are there. By themselves they predict the held-out samples "
            f"no better than that law (error {change(self.comparison)}): what tells the switches "
            "is not known. Record the signal that switches them."
        )

    def _of_surface(self, law: str, other: str) -> str:
        """Laws that leave only noise where they are told when to switch; a surface that is off."""
        return (
            f"Told when to switch, the {self._compared} leave nothing but noise, which no "
            "smooth law that was tried does; but by themselves they predict the held-out samples "
            f"no better than {law} (error {change(self.comparison)}): do not trust the switching "
            f"surface. Record more switches, from other states{other}.{self._in_their_place}"
        )

    def _smooth_advice(self) -> str:
        """To ask for the law of one mode, unless it lacks something as well."""
        if self.comparison.lacks_something:
            more = f"{self._asking}try another library"
            return f", nor that law, which leaves more than noise, too: {more}"
        return self._advice()

    @property
    def _in_their_place(self) -> str:
        """What to ask where modes by themselves leave the recordings they were found in."""
        astray = self.free is not None and not self.free.holds
        return f" {self.words.effects} asks what one law lacks in their place." if astray else ""

    @property
    def _beside_them(self) -> str:
        """What to ask of modes that are there, where by themselves they leave the recordings."""
        astray = self.free is not None and not (self.free.holds or self.free.hangs_on_start)
        asked = self.words.beside.format(self.n_modes) if astray and not self.leaves_open else ""
        return f" {asked} asks what they lack." if asked else ""

    @property
    def _asking(self) -> str:
        """To ask what one law lacks, of which nothing says that it leaves noise alone."""
        stands = self.noise is not None and not self.comparison.lacks_something
        return "" if stands else f"ask what one law lacks ({self.words.effects}), "

    def _advice(self) -> str:
        """To ask for the law of one mode that is best."""
        asked = self.words.law(self.comparison.best.terms)
        return f"; ask for that law: {asked}" if asked else ""
