"""The registered estimators for a terminal: their cost, what they need, and where they come from."""

from collections.abc import Iterator

from study.estimators import ESTIMATORS
from study.text.columns import columns


def printed() -> Iterator[str]:
    """A header, and a line per estimator."""
    rows = []
    for name, entry in ESTIMATORS.items():
        cost = f"{entry.flops(3):g} {entry.flops_of}".strip() if entry.flops else "-"
        rows.append([name, cost, entry.needs or "-", entry.reference])
    yield from columns(rows, ["estimator", "FLOPs per sample (3-D)", "needs", "from"])
