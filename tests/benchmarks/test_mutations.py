"""The sample of changes that tests have to notice: what is drawn, and how it is told."""

from benchmarks.mutations import annotations, page, plausible, within_budget


def test_only_what_somebody_could_have_typed_is_changed():
    assert plausible("core/ReplaceBinaryOperator_Add_Sub") and plausible("core/NumberReplacer")
    assert plausible("core/ReplaceComparisonOperator_Lt_LtE")
    assert not plausible("core/ReplaceBinaryOperator_Add_RShift")
    assert not plausible("core/ReplaceComparisonOperator_Lt_Is")


def test_types_are_left_alone():
    [one, other] = annotations("def f(x: int | None) -> str | None:\n    return x | None\n")
    assert {one, other} == {((1, 24), (1, 34)), ((1, 9), (1, 19))}


def test_the_shortest_tests_run_file_by_file():
    seconds = {"b::1": 1.0, "a::1": 2.0, "b::2": 3.0, "a::2": 90.0}
    chosen, total = within_budget(seconds)
    assert (chosen, total) == (["a::1", "b::1", "b::2"], 6.0)
    assert within_budget({"a::1": 90.0}) == (["a::1"], 90.0)


def test_what_was_not_noticed_is_told_with_its_reason():
    one = {"room": "metrics", "file": "a.py", "diff": "-x\n+y"}
    found = [one | {"outcome": word} for word in ("killed", "endless", "survived", "cut")]
    text = page(found)
    assert "| `metrics` | 1 | 1 | 1 | 1 | 0 | 50% |" in text
    assert text.count("A test is missing.") == 2
