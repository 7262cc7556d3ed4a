"""Shares of a run, for jobs that know nothing of each other: together they have the bytes of a run on one machine.

Faults of a share's folder, of one that is missing, and of one that was killed: each message says how to go on.
"""

import re

import pytest

from study.files import RunError
from study.simulation.experiment.config import parse
from study.simulation.runs import provenance, runner
from study.simulation.runs.parts import Layout, Share, ShareLayout
from study.simulation.runs.run_folder import Run
from study.simulation.runs.status import RunStatus

pytestmark = pytest.mark.usefixtures("same_software", "small_units", "small_parts")

PLAIN = {"top": {"keep_points": 2}, "trials": 40}
SUMMARY = {"top": {"keep": "summary"}, "trials": 40}
MEASURED = {"top": {"keep_points": 2, "measures": ["own_errors", "jaccard"]}, "trials": 17}
DESIGNS = pytest.mark.parametrize("design", [PLAIN, SUMMARY, MEASURED], ids=["plain", "summary", "measures"])


class Stop(BaseException):
    """Raised in a share to stop it."""


@pytest.fixture
def share(make_text, tmp_path):
    """Compute a share of a config of these arguments, into a folder named by its numbers."""

    def compute(number, of, folder=None, progress=None, warn=None, top=None, **design):
        text = make_text(top, **design)
        folder = folder or tmp_path / f"share-{number}-of-{of}"
        return runner.run_share(parse(text), text, folder, Share(number, of), 1, progress, warn).folder

    return compute


@pytest.fixture
def merge(make_text, tmp_path, start):
    """Put shares together, and finish the run."""

    def put(folders, folder=tmp_path / "merged", warn=None, top=None, **design):
        text = make_text(top, **design)
        runner.gather(parse(text), text, folder, folders, warn)
        return start(top, folder=folder, **design)

    return put


def bytes_of(run):
    """The bytes of a run's tables by name, without those of time."""
    return {path.name: path.read_bytes() for path in run.folder.glob("*.parquet") if path.stem != "timings"}


@pytest.mark.usefixtures("raises")
@DESIGNS
def test_shares_are_a_run(start, share, merge, computed, design):
    """The merged tables have the bytes of a run on one machine. Each fit is computed once, in one of the shares."""
    design = design | {"top": design["top"] | {"estimators": ["mle", "lls", "raises"]}}
    whole = start(**design)
    expected = sorted(computed)
    computed.clear()
    folders = [share(number, 3, **design) for number in (2, 3, 1)]
    assert sorted(computed) == expected
    computed.clear()
    merged = merge(folders, **design)
    assert computed == []
    assert bytes_of(merged) == bytes_of(whole)
    kept = whole.manifest(), merged.manifest()
    assert kept[0]["failures"] == kept[1]["failures"] > 0
    assert not (merged.folder / "parts").exists()


def test_more_shares_than_units(start, share, merge):
    """A share without units is complete, and the others have a unit each."""
    design = {"trials": 3, "samples": 6, "angle": 60}
    folders = [share(number, 9, **design) for number in range(1, 10)]
    assert sum(any((folder / "parts").glob("*.part")) for folder in folders) == len(list(start(**design).study.units()))
    assert "complete" in RunStatus(folders[-1]).state
    assert bytes_of(merge(folders, **design)) == bytes_of(start(**design))


@pytest.mark.parametrize("of", [1, 2, 5])
def test_shares_weigh_alike(make_text, of):
    """Every unit is in one share, and the weights of two shares differ by the heaviest unit at most."""
    made = parse(make_text(trials=40, samples=[6, 11, 40, 200]))
    layout = Layout(made)
    shares = [[layout.task(unit) for unit in ShareLayout(made, Share(number + 1, of)).pieces()] for number in range(of)]
    tasks = sorted(layout.task(unit).key for unit in made.units())
    assert sorted(task.key for tasks in shares for task in tasks) == tasks
    weights = [sum(task.weight for task in tasks) for tasks in shares]
    heaviest = max(task.weight for tasks in shares for task in tasks)
    assert max(weights) - min(weights) <= heaviest < min(weights)


def test_no_earlier_run_is_used(start, share, merge, tmp_path, computed):
    """A smaller run beside the shares, which other machines may not have, changes neither them nor the merged run."""
    top = {"name": "grown", "keep_points": 2}
    place = {number: tmp_path / f"grown-{number:010x}" for number in range(4)}
    start(top, trials=8, folder=place[0])
    whole = start(top, trials=40, folder=tmp_path / "alone" / "whole")
    computed.clear()
    folders = [share(number, 2, folder=place[number], top=top, trials=40) for number in (1, 2)]
    assert len(computed) == whole.manifest()["fits"]
    assert bytes_of(merge(folders, folder=place[3], top=top, trials=40)) == bytes_of(whole)


def test_a_share_that_was_killed(start, share, merge, computed):
    """Run again, it computes what is not stored, and no more; until then the merge names the share and the command."""

    def stop(*numbers):
        raise Stop

    with pytest.raises(Stop):
        share(1, 2, progress=stop, **PLAIN)
    folder = share(2, 2, **PLAIN).parent / "share-1-of-2"
    assert RunStatus(folder).state == "share 1/2 of a run, not complete; `study run CONFIG --part 1/2` resumes it"
    with pytest.raises(RunError, match=rf"missing shares: 1 of 2; .* --part 1/2 --out {re.escape(str(folder))}"):
        merge([folder, folder.parent / "share-2-of-2"], **PLAIN)
    before = len(computed)
    share(1, 2, **PLAIN)
    assert RunStatus(folder).state == "share 1/2 of a run, complete"
    assert len(set(computed)) == len(computed) > before
    merged = merge([folder, folder.parent / "share-2-of-2"], **PLAIN)
    assert len(computed) == merged.manifest()["fits"]
    assert bytes_of(merged) == bytes_of(start(**PLAIN))


def test_missing_shares_are_named(start, share, merge):
    """The first of them has its command. What is there is kept, and any shares that have the rest complete it."""
    folders = {number: share(number, 5, **PLAIN) for number in (1, 4)}
    with pytest.raises(RunError, match=r"missing shares: 2,3,5 of 5; `study run \S+ --part 2/5` computes the first of"):
        merge(folders.values(), **PLAIN)
    with pytest.raises(RunError, match="missing shares: 5 of 5;"):
        merge([share(number, 5, **PLAIN) for number in (2, 3)], **PLAIN)
    assert bytes_of(merge([share(1, 1, **PLAIN)], **PLAIN)) == bytes_of(start(**PLAIN))


def test_the_rest_here(start, share, merge, computed, tmp_path):
    """`study run` of the merged folder computes the rows of a missing share, and no others."""
    with pytest.raises(RunError, match="missing shares: 2 of 2;"):
        merge([share(1, 2, **PLAIN)], **PLAIN)
    there = len(computed)
    run = start(folder=tmp_path / "merged", **PLAIN)
    assert 0 < there < len(computed) == len(set(computed)) == run.manifest()["fits"]


def test_a_damaged_part(share, merge, start):
    """It is set aside, and the share is missing; run again, the share computes the rows of that part."""
    folders, lines = [share(number, 2, **PLAIN) for number in (1, 2)], []
    part = next((folders[1] / "parts").glob("*.part"))
    part.write_bytes(part.read_bytes()[:-9])
    with pytest.raises(RunError, match=rf"missing shares: 2 of 2; .* --part 2/2 --out {re.escape(str(folders[1]))}"):
        merge(folders, warn=lines.append, **PLAIN)
    assert [part.name in line and "damaged" in line for line in lines] == [True]
    share(2, 2, warn=lines.append, **PLAIN)
    assert "computed again" in lines[1]
    assert bytes_of(merge(folders, warn=lines.append, **PLAIN)) == bytes_of(start(**PLAIN))


def test_a_merged_run_is_finished(share, merge, files_of):
    """To merge it again changes nothing."""
    folders = [share(number, 2, **PLAIN) for number in (1, 2)]
    before = files_of(merge(folders, **PLAIN).folder)
    assert files_of(merge(folders[:1], **PLAIN).folder) == before


def test_folders_that_are_refused(share, merge, start, tmp_path):
    """Those of a whole run, of another config, of nothing; a share's folder for a run, and one for another share."""
    mine, whole = share(1, 2, **PLAIN), start(**PLAIN).folder
    other = share(1, 2, folder=tmp_path / "other", trials=41)
    for folders, words in (
        ([], r"no share of it is stored; `study run CONFIG --part 1/N`"),
        ([whole], r"holds no share of a run"),
        ([mine, other], rf"^{re.escape(str(other))}: holds a share of another config"),
        ([tmp_path / "nothing"], r"not a run folder"),
    ):
        with pytest.raises(RunError, match=words):
            merge(folders, **PLAIN)
    assert not (tmp_path / "merged").exists()
    with pytest.raises(RunError, match="is for share 1/2 of a run; `study merge`"):
        start(folder=mine, **PLAIN)
    with pytest.raises(RunError, match="was begun otherwise: share 2/2 instead of 1/2"):
        share(2, 2, folder=mine, **PLAIN)
    with pytest.raises(RunError, match="holds a run, and no share"):
        share(1, 2, folder=whole, **PLAIN)


def test_other_software(share, merge, monkeypatch):
    """A share that other software computed, by whose bits the run would differ, is neither gone on with nor merged."""
    folder, real = share(1, 1, **PLAIN), provenance.fingerprint
    monkeypatch.setattr(provenance, "fingerprint", lambda: real() | {"numpy": "another"})
    mine = re.escape(str(real()["numpy"]))
    with pytest.raises(RunError, match=f"was begun otherwise: numpy another instead of {mine}; remove it"):
        share(1, 1, **PLAIN)
    with pytest.raises(RunError, match=f"other software: here is numpy another instead of {mine}; merge with that"):
        merge([folder], **PLAIN)


def test_a_run_that_goes_on_with_an_earlier_one(share, merge, start, tmp_path):
    """Its units are cut otherwise, so that shares do not complete it: the message says what does."""

    def stop(*numbers):
        raise Stop

    top = {"name": "grown", "keep_points": 2}
    start(top, trials=10, folder=tmp_path / f"grown-{0:010x}")
    with pytest.raises(Stop):
        start(top, trials=40, folder=tmp_path / f"grown-{1:010x}", progress=stop, warn=str)
    with pytest.raises(RunError, match="goes on with an earlier one"):
        merge([share(1, 1, top=top, trials=40)], folder=tmp_path / f"grown-{1:010x}", top=top, trials=40)


def test_a_damaged_share_file(share, merge):
    """The message names it."""
    folder = share(1, 1, **PLAIN)
    (folder / "share.json").write_text("{}")
    with pytest.raises(RunError, match=r"share\.json: cannot be read; remove the folder"):
        merge([folder], **PLAIN)


def test_trials_by_need_have_no_shares(share, merge, tmp_path):
    """Their units follow from the rows of all: both commands say so, and nothing is made."""
    needs = {"top": {"precision": {"relative_target": 0.08, "first": 100}}, "trials": 400}
    for act in (lambda: share(1, 2, **needs), lambda: merge([], **needs)):
        with pytest.raises(RunError, match=r"\[precision\] decides by all rows .* leave it out, or use --backend dask"):
            act()
    assert list(tmp_path.iterdir()) == []


def test_shares_are_read():
    """K/N, from 1/N to N/N; anything else is refused with what to write."""
    assert [Share.parse(text) for text in ("1/1", "3/40", "40/40")] == [(1, 1), (3, 40), (40, 40)]
    assert str(Share(3, 40)) == "3/40"
    for text in ("0/40", "41/40", "x", "", "3", "3/", "-1/4", "1/0", "1.5/2", " 1/2", "1/2\n", "¹/2"):
        with pytest.raises(ValueError, match="give K/N, the K-th of N shares, from 1/N to N/N, such as 3/40"):
            Share.parse(text)


def test_the_folder_says_what_it_is_for(share):
    """The share and the software that computes it are stored before anything is computed."""

    def stop(*numbers):
        raise Stop

    with pytest.raises(Stop):
        share(2, 3, progress=stop, **PLAIN)
    folder = share(1, 3, **PLAIN).parent / "share-2-of-3"
    assert Run.open(folder).share() == (Share(2, 3), provenance.fingerprint())
