"""Reports as mappings from the names of their parts, in types that JSON knows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, is_dataclass
from typing import Any, ClassVar

import numpy as np


class Parts(Mapping[str, Any]):
    """An object that is also a mapping of some of its attributes, by their names."""

    _parts: ClassVar[tuple[str, ...]] = ()

    def __getitem__(self, name: str) -> Any:
        if name not in self._parts:
            known = ", ".join(self._parts)
            raise KeyError(f"{name!r} is no part of the report; these are: {known}.")
        return getattr(self, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def to_dict(self) -> dict[str, object]:
        """Everything but `data`, in types that JSON knows; NaN becomes None."""
        return entries_of(self)

    def __repr__(self) -> str:
        return str(self)


def entries_of(values: Mapping[str, object]) -> dict[str, object]:
    """A mapping in types that JSON knows; what is not finite becomes None."""
    return {str(name): plain(entry) for name, entry in values.items()}


def plain(value: object) -> object:
    """The same in types that JSON knows; what is not finite becomes None."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Mapping):
        return entries_of(value)
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, (tuple, list)):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
