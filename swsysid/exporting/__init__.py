"""Identified systems for other tools: SymPy, python-control, CasADi, C, FMI, Modelica, MATLAB.

*Problem.* A model that is a function of Python runs where Python runs; a controller is designed
elsewhere. *In*: any fitted or stated model. *Out*: formulas, in the language of the tool.

Every model gives one `HybridSystem` (``model.to_hybrid_system()``): laws, surfaces, guards and
resets as formulas. The writers read nothing else, and are methods of every model (``to_c``, ...).

In reading order: `_expressions` are formulas, `_features` those of a library, `_system` the
description, `_slides` makes guards of surfaces and modes of slides; `_text` prints formulas; the
others write for the tool of their name, and `_tools` gives them to the models.
"""

from swsysid.exporting._casadi import CasadiSystem, CasadiTransition
from swsysid.exporting._expressions import Expression, NoFormulaError
from swsysid.exporting._sympy import SymbolicSystem, SymbolicTransition
from swsysid.exporting._system import Edge, HybridSystem, Surfaces
from swsysid.exporting._tools import ToOtherTools

__all__ = [
    "CasadiSystem",
    "CasadiTransition",
    "Edge",
    "Expression",
    "HybridSystem",
    "NoFormulaError",
    "Surfaces",
    "SymbolicSystem",
    "SymbolicTransition",
    "ToOtherTools",
]
