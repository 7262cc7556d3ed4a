"""Published fits of published points, and the published tail of Kåsa's centre: this program has the same numbers."""

import sys
from pathlib import Path

import pandas as pd
import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tools"))
import reference_tables  # noqa: E402

sys.path.remove(str(ROOT / "tools"))


def test_published_fits():
    """Each is the published number in all of its digits; the stored table has them."""
    table = reference_tables.published_fits()
    assert len(table) >= 10
    assert table["ours"].tolist() == table["published"].tolist()
    stored = pd.read_csv(reference_tables.STORED / "published-fits.csv")
    assert stored["published"].tolist() == table["published"].tolist()


@pytest.mark.parametrize("samples", [3, 4, 5])
def test_the_tail_of_the_centre(samples):
    """Its index is N - 2, within 4 standard errors: a false alarm in 16,000 tests of a correct program, per N."""
    index, error = reference_tables.tail_index(samples, 200_000, 2)
    assert index == pytest.approx(samples - 2, abs=4.0 * error)
    assert error < 0.08 * index
