"""The worker's entry point: it calls what it is given, unless it would compute other bytes than its parent."""

import shutil

import pytest

from study.simulation.runs import provenance, workers
from study.simulation.runs.workers import DisagreementError, enter, introduction, seal


@pytest.fixture(autouse=True)
def _fresh(monkeypatch):
    """Let this process stand for a worker that has not had a task yet."""
    monkeypatch.setattr(workers, "_agreed", [])


def test_a_worker_like_its_parent_computes():
    """A worker that is as its parent calls the function."""
    assert enter(introduction(), seal(divmod, 17, 5)) == (3, 2)


@pytest.mark.parametrize("name", ["numpy", "code generated for", "sources"])
def test_a_worker_that_differs_refuses(name):
    """It says what differs, and calls nothing; a later task from a parent that agrees is computed."""
    parent = introduction()
    other = parent._replace(fingerprint=parent.fingerprint | {name: "another"})
    with pytest.raises(DisagreementError, match=f"{name} .* instead of another") as refused:
        enter(other, b"this cannot be unpickled")
    assert f"{name} {parent.fingerprint[name]} instead of another" in str(refused.value)
    assert enter(parent, seal(divmod, 17, 5)) == (3, 2)


@pytest.mark.parametrize(
    "changed", ["fits/closed_forms.py", "simulation/experiment/sampling.py", "simulation/statistics.py"]
)
def test_another_source_is_another_fingerprint(tmp_path, monkeypatch, changed):
    """A worker whose code of the fits, the experiment or the statistics differs in one byte would be refused."""
    home = shutil.copytree(provenance._HOME, tmp_path / "study", ignore=shutil.ignore_patterns("__pycache__"))
    before = provenance.fingerprint()["sources"]
    monkeypatch.setattr(provenance, "_HOME", home)
    assert provenance.fingerprint()["sources"] == before
    (home / changed).write_text((home / changed).read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert provenance.fingerprint()["sources"] != before
