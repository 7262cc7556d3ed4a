"""The order in which compiled code adds does not depend on where arrays happen to lie in memory."""

import pytest

from tests.near import compare

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def compared():
    """Closed forms in five dimensions, whose sums are arrays, as they are and with small arrays near each other."""
    return compare(5, "lls", "gdke", "ugdk")


def test_no_bit_depends_on_where_small_arrays_lie(compared):
    """LLS in five dimensions once did.

    A loop that is known to depend on it does, so that a compiler which words its decision differently is noticed.
    """
    differ, _, count = compared
    assert differ.pop("stored and summed") > 20
    assert differ == {}
    assert count > 2000


KNOWN = ("stored_and_summed", "moments10accumulate")
"""Names that may be listed: the loop that is made so, and sums of moments in five dimensions or more. The latter have
such a version for coordinates of a sample that follow each other in memory, which no layout has that kernels read."""


def test_no_other_loop_that_is_chosen_by_nearness_carries_a_sum(compared):
    """Whatever the numbers are, there is no other such loop in the compiled code."""
    _, loops, _ = compared
    assert any(KNOWN[0] in name for name in loops)
    assert [name for name in loops if not any(known in name for known in KNOWN)] == []
