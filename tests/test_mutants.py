"""The mutants of a text: one token each, and programs all."""

from mutants import mutants

TEXT = '''"""Text with + and 1 in it."""


def f(*values, low=0.5):  # 3 < 4
    return values[0] < low and not values
'''


def test_each_mutant_has_one_other_token():
    """Numbers, comparisons and words change; texts, comments and what would be no program stay."""
    found = {(row, old, new) for row, old, new, _ in mutants(TEXT)}
    numbers = {(4, "0.5", "(0.5 + 1)"), (5, "0", "(0 + 1)")}
    assert found == numbers | {(5, "<", "<="), (5, "and", "or"), (5, "not", "")}
    before = TEXT.split("\n")
    for row, old, new, whole in mutants(TEXT):
        after = whole.split("\n")
        assert [k for k, line in enumerate(before, 1) if after[k - 1] != line] == [row]
        assert after[row - 1] == before[row - 1].replace(old, new, 1)
