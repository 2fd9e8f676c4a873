"""What is said of rows with gross errors: how many there are, where and when."""

from __future__ import annotations

from swsysid._effect_search.contents import EffectContents, RowsSetAside
from swsysid._effect_search.words import joined, probability


def aside(report: EffectContents) -> str:
    """How many rows are set aside and where they are, in a sentence; "" if there are none."""
    one = report.set_aside
    if one is None or not one["n_rows"]:
        return ""
    share = one["n_rows"] / (report.n_search + report.n_held_out)
    if one["n_rows"] == 1:
        return f"1 row ({share:.1%}) has a gross error and is set aside."
    told = f"{one['n_rows']} rows ({share:.1%}) have gross errors and are set aside"
    if not one["n_together"]:
        return f"{told}; no two of them follow each other."
    where = _where(one)
    place = (
        f"{one['n_together']} of them lie together in {one['n_trajectories']} "
        f"{'trajectory' if one['n_trajectories'] == 1 else 'trajectories'}, "
        f"{where or 'at no place of their own'}"
    )
    event = one["time_interval"]
    if event is not None:
        beside = ", beside the effects" if report.effects else ""
        seen = f", with {where}: time and place cannot be told apart" if where else ""
        times = [f"{begin:.4g} to {end:.4g}" for begin, end in event["intervals"]]
        once = len(times) == 1
        return (
            f"{told}; {event['n_rows']} of them follow each other from {joined(times)} in "
            f"trajectory {event['trajectory']}: another law acts for "
            f"{'that time' if once else 'these times'} ({probability(one['p_value'])}){beside}: "
            f"{'; '.join(event['law'])}. It is seen {'once' if once else f'{len(times)} times'}"
            f"{seen}."
        )
    if not one["is_finding"]:
        return f"{told}; {place}."
    # a place in which the usual law holds in more rows is not all that the other one needs
    others = report.n_search + report.n_held_out - one["n_together"]
    there = one["place"]
    few = there is not None and there["others"] * others <= there["n_rows"]
    when = "there" if few else "there at times" if where else "at times"
    return (
        f"{told}; {place}: another law acts {when}, one more mode, "
        f"a stop or a collision ({probability(one['p_value'])})."
    )


def _where(rows: RowsSetAside) -> str:
    """The place of those that lie together, "" if it is everywhere."""
    place = rows["place"]
    if place is None:
        return ""
    low, high = place["interval"]
    most = "" if place["n_rows"] == rows["n_together"] else f"{place['n_rows']} with "
    return (
        f"{most}{place['channel']} between {low:.4g} and {high:.4g} "
        f"(where {place['others']:.1%} of the others are)"
    )
