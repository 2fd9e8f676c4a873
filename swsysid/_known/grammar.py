"""Sentences about laws, read and never evaluated.

    sentence = sum "=" sum | sum "<=" sum | sum ">=" sum | number "<=" sum "<=" number
             | law "has no" terms | law "has only" terms
             | law "same in all modes" | coefficient "same in all modes"
             | "guard" sum ("=" | "<=" | ">=") ("*" | sum) | "guard has only" terms
             | "energy" sum "never rises"
    law      = name "'"             the left side of a printed equation; x[k+1] is read as x'
    coefficient = law "[" term "]"  what stands before the term in the law
    sum      = of coefficients and numbers, or of laws, terms and numbers, each perhaps with a
               number before it: v'[x] + 2 w'[x], x0' + x1', 2 v - 9.81
    terms    = names between commas; "other terms" are those that no sentence names

The sum of a guard has terms and numbers: modes change where it passes a threshold, which is sought
where it is "*". Which mode is on which side is found. An energy is a sum of squares and products of
states, such as 4 x^2 + v^2.

A term may end with a prime itself, as the speed x' where positions are measured: to the right of
"=" it is a term if there is one of that name, and else a law.

Names are those of the printed equations; one with a sign, a comma or a digit in front stands in
backquotes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from swsysid._checks.parameters import shown
from swsysid._known.sentences import (
    REST,
    Energy,
    GuardOnly,
    GuardSum,
    Identity,
    Only,
    Part,
    Relation,
    Same,
    Sentence,
    Without,
)

_RELATION = re.compile(r"<=|>=|=|<|>")
_DIGITS = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"{_DIGITS}(?=\s*\*?\s*(?:[^\W\d]|`|$))")
_EXPONENT = re.compile(r"(?:^|[^\w`])(?:\d+\.?\d*|\.\d+)[eE]$")
_HAS = re.compile(r"(?P<law>.*'`?)\s+has\s+(?P<how>no|only)\s+(?P<terms>.*)", re.DOTALL)
_SAME = re.compile(r"(?P<of>.*?\S)\s+(?:is |are )?(?:the )?same in (?:all|every) modes?")
_GUARD = re.compile(r"guard\s+(?:(?P<only>has\s+only\s)|)(?P<of>.*)", re.DOTALL)
_ENERGY = re.compile(r"(?:the )?energy\s+(?P<of>.*?\S)\s+never (?:rises|grows|increases)")
_SOUGHT = "*"  # a threshold that is sought
_OTHERS = ("other terms", "other term", "others", REST)
_OPEN, _CLOSE = "([{", ")]}"
_EXAMPLES = (
    """"x' = v", "v'[x] = -9.81", "v'[v] <= 0", "v' has no u", "v'[u] same in all modes", """
    """"guard x >= *", "energy x^2 + v^2 never rises\""""
)


def read(text: object) -> Sentence:
    """The sentence of a text; ValueError where it is none of the grammar."""
    if not isinstance(text, str) or not text.strip():
        raise ValueError(f"known={shown(text)} must be a sentence such as {_EXAMPLES}.")
    sentence = " ".join(text.split()).rstrip(".; ").replace("[k+1]", "'").replace("’", "'")
    if re.search(r"\bin modes? \d", sentence):
        raise ValueError(
            f"known={text.strip()!r} is of single modes, but which mode has which number is known "
            "only after a fit; say it of all modes, or that something is the same in all."
        )
    if (found := _GUARD.fullmatch(sentence)) is not None:
        return _guard(found, text)
    if (found := _ENERGY.fullmatch(sentence)) is not None:
        own = list(_parts(found["of"], text))
        if any(one.term == "1" or (one.equation and one.term) for one in own):
            raise _refused(text, "an energy is of squares and products of states")
        named = (Part(one.weight, "", one.term or f"{one.equation}'") for one in own)
        return Energy(tuple(named))
    if (found := _SAME.fullmatch(sentence)) is not None:
        own = list(_parts(found["of"], text))
        if len(own) != 1 or own[0].weight != 1.0 or not own[0].equation:
            raise _refused(text, "a law or a coefficient is the same in all modes")
        return Same(own[0].equation, own[0].term or REST)
    if (found := _HAS.fullmatch(sentence)) is not None:
        return _terms(found, text)
    return _relation(sentence, text)


def _refused(text: str, why: str) -> ValueError:
    return ValueError(
        f"known={text.strip()!r} cannot be read: {why}. Sentences are such as {_EXAMPLES}."
    )


def _terms(found: re.Match[str], text: str) -> Sentence:
    own = list(_parts(found["law"], text))
    if len(own) != 1 or not own[0].equation or own[0].term:
        raise _refused(text, f"{found['law']} is no law")
    names = _listed(found["terms"], text)
    if found["how"] == "no":
        return Without(own[0].equation, names)
    if REST in names:
        raise _refused(text, "it must say which terms there are")
    return Only(own[0].equation, names)


def _listed(terms: str, text: str) -> tuple[str, ...]:
    listed = [one.strip() for one in _split(terms, ",")]
    names = tuple(REST if one in _OTHERS else _bare(one) for one in listed)
    if not all(names):
        raise _refused(text, "a term is missing")
    return names


def _guard(found: re.Match[str], text: str) -> Sentence:
    if found["only"]:
        if REST in (names := _listed(found["of"], text)):
            raise _refused(text, "it must say which terms there are")
        return GuardOnly(names)
    sides = list(_split(found["of"], _RELATION.pattern))
    if len(sides) != 2:
        raise _refused(text, "a guard is a sum, one relation and a threshold, as guard x >= *")
    if _SOUGHT in found["of"].removesuffix(_SOUGHT) or sides[0].strip() == _SOUGHT:
        raise _refused(text, "* stands for a threshold, alone and to the right")
    sought = sides[1].strip() == _SOUGHT
    parts = list(_parts(sides[0], text))
    parts += [] if sought else [one.times(-1.0) for one in _parts(sides[1], text)]
    if any(one.equation for one in parts):
        raise _refused(text, "a guard is of states and inputs, not of laws")
    own = tuple(one for one in parts if one.term != "1")
    if not own:
        raise _refused(text, "it names no state or input")
    level = 0.0 - sum(one.weight for one in parts if one.term == "1")
    if sought and level:
        raise _refused(text, "its threshold is sought, and a number beside it says nothing")
    return GuardSum(own, None if sought else level)


def _relation(sentence: str, text: str) -> Sentence:
    signs = _outside(sentence, _RELATION)
    begins, ends = [0, *(one.end() for one in signs)], [*(one.start() for one in signs), None]
    sides = [sentence[begin:end] for begin, end in zip(begins, ends, strict=True)]
    kinds = [one[0][0] for one in signs]
    if not kinds:
        raise _refused(text, "it is none of the sentences that there are")
    if len(kinds) == 2 and kinds[0] == kinds[1] != "=":
        low, middle, high = sides if kinds[0] == "<" else sides[::-1]
        parts = list(_parts(middle, text))
        return _bounded(parts, _number(low, text), _number(high, text), text)
    if len(kinds) != 1:
        raise _refused(text, "it has more than one relation; write a sentence for each")
    left, right = (tuple(_parts(side, text)) for side in sides)
    parts = [*left, *(one.times(-1.0) for one in right)]
    if kinds[0] != "=" or all(one.term for one in parts):
        low_bound, high_bound = {"=": (0.0, 0.0), "<": (-np.inf, 0.0), ">": (0.0, np.inf)}[kinds[0]]
        return _bounded(parts, low_bound, high_bound, text)
    if any(one.equation and one.term for one in parts):
        raise _refused(text, "it mixes laws with coefficients")
    terms = tuple(one.times(-1.0) for one in left if not one.equation)
    return Identity(tuple(one for one in left if one.equation), (*right, *terms))


def _bounded(parts: list[Part], lower: float, upper: float, text: str) -> Relation:
    """Bounds of a sum of coefficients, its numbers on their side."""
    own = [one for one in parts if one.equation and one.term]
    numbers = [one.weight for one in parts if not one.equation and one.term == "1"]
    if not own or len(own) + len(numbers) < len(parts):
        raise _refused(text, "it must be of coefficients such as v'[x] and numbers")
    scale = own[0].weight if len(own) == 1 else 1.0  # v'[x] alone
    ends = [(end - sum(numbers)) / scale + 0.0 for end in (lower, upper)]
    low, high = ends if scale > 0.0 else ends[::-1]
    return Relation(tuple(one.times(1.0 / scale) for one in own), low, high)


def _number(side: str, text: str) -> float:
    try:
        if np.isfinite(value := float(side)):
            return value
    except ValueError:
        pass
    raise _refused(text, f"{side.strip()!r} is no finite number")


def _parts(side: str, text: str) -> Iterator[Part]:
    """Coefficients, laws (without a term) and terms (without an equation) of a sum."""
    side = side.strip()
    if not side:
        raise _refused(text, "a side is missing")
    cuts = [one.start() for one in _outside(side, re.compile(r"[+-]"))]
    cuts = [0, *(cut for cut in cuts if cut and not _EXPONENT.search(side[:cut]))]
    for part in (side[a:b].strip() for a, b in zip(cuts, [*cuts[1:], None], strict=True)):
        sign, rest = -1.0 if part[0] == "-" else 1.0, part[part[0] in "+-" :].strip()
        found = _NUMBER.match(rest)
        weight = sign * (float(found[0]) if found else 1.0)
        if not np.isfinite(weight):
            raise _refused(text, f"{found and found[0]} is no finite number")
        rest = rest[found.end() :].lstrip(" *") if found else rest
        if not rest and found is None:
            raise _refused(text, "a sign stands alone")
        if rest or weight:
            yield _atom(rest or "1", text).times(weight)


def _atom(part: str, text: str) -> Part:
    name, prime, term = part.partition("'[")
    if prime and part.endswith("]") and _bare(term[:-1]):
        return Part(1.0, _bare(name), _bare(term[:-1]))
    if part.endswith("'") and _bare(part[:-1]):
        return Part(1.0, _bare(part[:-1]))
    return Part(1.0, "", _bare(part))


def _bare(name: str) -> str:
    name = name.strip()
    return name[1:-1] if len(name) > 1 and name[0] == name[-1] == "`" else name


def _split(text: str, at: str) -> Iterator[str]:
    begin = 0
    for one in _outside(text, re.compile(at)):
        yield text[begin : one.start()]
        begin = one.end()
    yield text[begin:]


def _outside(text: str, pattern: re.Pattern) -> list[re.Match]:
    """Matches outside of brackets and backquotes."""
    masked, depth, quoted = list(text), 0, False
    for place, letter in enumerate(text):
        quoted ^= letter == "`"
        depth += 0 if quoted else (letter in _OPEN) - (letter in _CLOSE)
        if quoted or depth > 0 or letter in _CLOSE:
            masked[place] = "\0"
    return list(pattern.finditer("".join(masked)))
