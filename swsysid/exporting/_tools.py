"""The writers as methods of every model."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from swsysid._whole_or_nothing import write_text
from swsysid.exporting._c import c_source
from swsysid.exporting._casadi import CasadiSystem, casadi_system
from swsysid.exporting._control import nonlinear_system
from swsysid.exporting._fmu import write_fmu
from swsysid.exporting._matlab import matlab_source
from swsysid.exporting._modelica import modelica_source
from swsysid.exporting._sympy import SymbolicSystem, symbolic
from swsysid.exporting._system import HybridSystem

if TYPE_CHECKING:
    import control


class ToOtherTools:
    """A model that other tools can be told.

    All refuse in one sentence (`NoFormulaError`) a part of the model that is no formula, and what
    the tool cannot say.
    """

    @abstractmethod
    def to_hybrid_system(self) -> HybridSystem:
        """Laws, surfaces, guards and resets as formulas.

        Returns
        -------
        HybridSystem

        Raises
        ------
        NoFormulaError
            If a part of the model is no formula; the sentence says which.
        """

    def to_sympy(self) -> SymbolicSystem:
        """Laws, surfaces, guards and resets for SymPy (``pip install "swsysid[sympy]"``).

        Returns
        -------
        SymbolicSystem

        Raises
        ------
        NoFormulaError
            If a part of the model is no formula.

        Examples
        --------
        >>> from swsysid import HybridAutomaton
        >>> ball = HybridAutomaton.stated(
        ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
        ... )
        >>> symbolic = ball.to_sympy()
        >>> symbolic.laws[0][0], symbolic.transitions[0].guard
        (v, -h)
        """
        return symbolic(self.to_hybrid_system())

    def to_control(
        self, name: str = "model", *, mode: int | None = None
    ) -> control.NonlinearIOSystem:
        """A nonlinear system for python-control (``pip install "swsysid[control]"``).

        Its outputs are the states. python-control has no events: where the state alone tells the
        mode the law is the active one, and its solver steps over the surfaces (a warning says so).

        Parameters
        ----------
        name : str, default="model"
        mode : int, default=None
            The law of this mode alone; needed where modes have memory or the state jumps.

        Returns
        -------
        control.NonlinearIOSystem

        Raises
        ------
        NoFormulaError
            If a part of the model is no formula, or modes have memory and `mode` is not given.

        Warns
        -----
        UserWarning
            If there are surfaces, which the solver steps over.

        Examples
        --------
        >>> import control
        >>> from swsysid import HybridAutomaton
        >>> tank = HybridAutomaton.stated([{"h": "u - 0.5 h"}], states=["h"], inputs=["u"])
        >>> control.linearize(tank.to_control(), [2.0], [1.0]).A.round(6)
        array([[-0.5]])
        """
        return nonlinear_system(self.to_hybrid_system(), name, mode)

    def to_casadi(self) -> CasadiSystem:
        """Functions for CasADi: one a mode, guards beside (``pip install "swsysid[casadi]"``).

        Returns
        -------
        CasadiSystem

        Raises
        ------
        NoFormulaError
            If a part of the model is no formula.

        Examples
        --------
        >>> from swsysid import HybridAutomaton
        >>> thermostat = HybridAutomaton.stated(
        ...     [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        ...     [(0, 1, "T >= 22"), (1, 0, "T <= 20")],
        ...     states=["T"],
        ... )
        >>> written = thermostat.to_casadi()
        >>> float(written.laws[0]([20.0], [], 0.0)), float(
        ...     written.transitions[0].guard([20.0], [], 0.0, 0.0))
        (1.0, -2.0)
        """
        return casadi_system(self.to_hybrid_system())

    def to_c(self, path: str | Path, name: str | None = None) -> None:
        """Write one C99 file without dependencies.

        It has the laws (``NAME_rhs``), guards and resets, a start (``NAME_begin``) and steps that
        locate events to the last digit of the time (``NAME_step``); in discrete time ``NAME_row``
        and ``NAME_step``. What each takes and returns stands in the file.

        Parameters
        ----------
        path : str or path
        name : str, default=None
            Begins all names of the file; None is the name of the file.

        Raises
        ------
        NoFormulaError
            If a part of the model is no formula.
        OSError
            If the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> from swsysid import HybridAutomaton
        >>> ball = HybridAutomaton.stated(
        ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
        ... )
        >>> path = Path(tempfile.mkdtemp()) / "ball.c"
        >>> ball.to_c(path)
        >>> "int ball_step(" in path.read_text()
        True
        """
        write_text(path, c_source(self.to_hybrid_system(), _named(path, name)))

    def to_modelica(
        self,
        path: str | Path,
        name: str | None = None,
        *,
        x0: ArrayLike | None = None,
        mode: int | None = None,
    ) -> None:
        """Write a Modelica model: transitions in ``when``, resets by ``reinit``.

        Parameters
        ----------
        path : str or path
            Usually ends in ``.mo``.
        name : str, default=None
            Of the model; None is the name of the file.
        x0 : array-like of shape (n_states,), default=None
            The state at the start; None is the middle of the data or the first recorded state.
        mode : int, default=None
            The mode at the start; None is the one that the state tells, or the first recorded.

        Raises
        ------
        NoFormulaError
            If a part of the model is no formula, or in discrete time.
        ValueError
            If `x0` is of another shape, or `mode` none of the modes.
        OSError
            If the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> from swsysid import HybridAutomaton
        >>> ball = HybridAutomaton.stated(
        ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
        ... )
        >>> path = Path(tempfile.mkdtemp()) / "Ball.mo"
        >>> ball.to_modelica(path, x0=[10.0, 0.0])
        >>> "when pre(mode) == 0 and -h > 0 then" in path.read_text()
        True
        """
        source = modelica_source(self.to_hybrid_system(), _named(path, name), x0, mode)
        write_text(path, source)

    def to_matlab(self, path: str | Path, name: str | None = None) -> None:
        """Write one MATLAB function, which GNU Octave runs too.

        It gives a struct of functions: the laws (``rhs``), guards and resets, an event function as
        ``odeset`` takes it (``events``), and ``simulate``, which locates events by itself.

        Parameters
        ----------
        path : str or path
            ``NAME.m``: MATLAB calls a function by the name of its file.
        name : str, default=None
            Of the function; None is the name of the file.

        Raises
        ------
        NoFormulaError
            If a part of the model is no formula, or in discrete time.
        OSError
            If the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> from swsysid import HybridAutomaton
        >>> ball = HybridAutomaton.stated(
        ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
        ... )
        >>> path = Path(tempfile.mkdtemp()) / "ball.m"
        >>> ball.to_matlab(path)
        >>> "y(2) = -0.8*x(2);" in path.read_text()
        True
        """
        write_text(path, matlab_source(self.to_hybrid_system(), _named(path, name)))

    def to_fmu(self, path: str | Path, name: str | None = None, *, fmi_version: int = 2) -> None:
        """Write a functional mock-up unit for model exchange, as source code.

        It holds no binary and needs no Python: the importer compiles ``sources/model.c``. Guards
        are event indicators with the hysteresis that the standard asks for. ``mode_start`` is
        the mode to start in, ``mode`` that of the model, ``mode_or_slide`` the one with slides and
        sticking friction as modes of their own.

        Parameters
        ----------
        path : str or path
            Usually ends in ``.fmu``.
        name : str, default=None
            Of the model; None is the name of the file.
        fmi_version : {2, 3}, default=2
            Version of the standard.

        Raises
        ------
        NoFormulaError
            If a part of the model is no formula, or in discrete time.
        ValueError
            If there is no such version.
        OSError
            If the file cannot be written.

        Examples
        --------
        >>> import tempfile, zipfile
        >>> from pathlib import Path
        >>> from swsysid import HybridAutomaton
        >>> ball = HybridAutomaton.stated(
        ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
        ... )
        >>> path = Path(tempfile.mkdtemp()) / "ball.fmu"
        >>> ball.to_fmu(path)
        >>> zipfile.ZipFile(path).namelist()
        ['modelDescription.xml', 'sources/model.c']
        """
        write_fmu(self.to_hybrid_system(), path, _named(path, name), fmi_version)


def _named(path: str | Path, name: str | None) -> str:
    return Path(path).stem if name is None else name
