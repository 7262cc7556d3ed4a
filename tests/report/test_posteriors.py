"""Posteriors on the page where there are none."""

from types import SimpleNamespace

import pandas as pd

from study.report.posterior import posterior_section


def test_a_table_without_rows():
    """A run whose table of posteriors has no row has no section."""
    run = SimpleNamespace(has=lambda name: True, table=lambda name: pd.DataFrame())
    material = SimpleNamespace(records=[SimpleNamespace(run=run, name="empty")])
    assert list(posterior_section(material)) == []
