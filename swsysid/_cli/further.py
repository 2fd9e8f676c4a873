"""What the command does by itself where its first answer asks for something else.

Two modes are the first question. Where held-out recordings refute them, the answer says which
question is next: what one law lacks, or which guard remembers. That one is asked at once; what was
answered before stays as it was printed and saved.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from swsysid._cli.automaton import run_automaton
from swsysid._cli.diagnosis import diagnosed, states_jump
from swsysid._cli.job import JobResult
from swsysid._cli.options import JobOptions
from swsysid._cli.saving import save_diagnosis
from swsysid._rendering.progress import stage
from swsysid._results import SolverError
from swsysid._tables.table import Table
from swsysid.effects import all_effects


@dataclass(frozen=True)
class Further:
    """A question after the first one, of the same recordings."""

    table: Table
    options: JobOptions
    folder: Path
    page: Path
    checksum: str
    watched: bool

    def asked(self, result: JobResult, before: str) -> int:
        """Ask what the first answer leaves open, if anything, beside what was said `before`."""
        # laws may follow all stretches between two jumps, and say nothing of the jumps
        is_open = result.verdict.leaves_open or states_jump(result.samples, self.options)
        if result.remembers:
            what, ask = "an automaton is identified, as by --automaton", self._memory
        elif is_open:
            what, ask = "what one law lacks is searched for, as by --diagnose", self._effects
        else:
            return 0
        said = f"So {what}; --modes 2 leaves that out."
        print(f"\n{said}\n", flush=True)
        try:
            return ask(f"{before}\n\n{said}")
        except (ValueError, SolverError) as why:  # the first answer does not depend on it
            print(f"That gives nothing: {why}")
            return 0

    def _effects(self, before: str) -> int:
        found = diagnosed(
            self.table, self.options, all_effects(), is_left_open=True, watched=self.watched
        )
        return save_diagnosis(
            *found.saved, found.answer, self.folder, self.page, self.checksum, before
        )

    def _memory(self, before: str) -> int:
        options = replace(self.options, modes="auto")
        with stage("Identifying an automaton", self.watched):
            return run_automaton(self.table, options, self.folder, self.checksum, before)
