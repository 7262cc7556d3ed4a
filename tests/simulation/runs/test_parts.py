"""Part files: rows are read as they were written, damage is found, and many packets share a file.

Tasks: what they weigh, how units are cut, which rows of another run they share, and the order of rows.
"""

import hashlib
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from study.files import RunError
from study.simulation.experiment.compute import compute
from study.simulation.experiment.config import parse
from study.simulation.experiment.designs import Batch
from study.simulation.runs import parts as module
from study.simulation.runs import schemas
from study.simulation.runs.parts import DAMAGED, FORMAT, Layout, Packet, Parts, order, shorter, tables, takes_long
from tests.configs import config, log_uniform


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """The time, in seconds, which stands still unless a test sets it: a part is written early after a second."""
    now = [0.0]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now[0]))
    return now


def packet(key, outputs=("a@1",), rows=3, value=0.0):
    """A packet of one key."""
    table = pa.table({"x": [value] * rows, "word": pa.array(["w"] * rows).dictionary_encode()})
    return Packet.of([(key, outputs)], [{"errors": table}])


def stored(folder, *packets):
    """Parts that hold packets, in one file."""
    parts = Parts(folder, "units", {"study": "1"})
    for each in packets:
        parts.add(each)
    parts.commit()
    return parts


def opened(folder, **arguments):
    """The parts of a folder, read again."""
    parts = Parts(folder, "units", {"study": "1"})
    parts.load(**arguments)
    return parts


def found(parts, key):
    """Outputs and rows of a key."""
    return [(outputs, table["x"].to_pylist()) for _, outputs, table in parts.tables(key, "errors")]


def test_what_is_written_is_read(tmp_path):
    """Keys, their outputs and rows come back from one file; an unknown key has none."""
    stored(tmp_path, packet("k", value=1.0), packet("l", ("a@1", "b@2"), 2, 2.0))
    parts = opened(tmp_path)
    assert parts.count == len(list((tmp_path / "parts").iterdir())) == 1
    assert parts.outputs("k") == {"a@1"}
    assert parts.outputs("l") == {"a@1", "b@2"}
    assert found(parts, "k") == [(("a@1",), [1.0] * 3)]
    assert found(parts, "l") == [(("a@1", "b@2"), [2.0] * 2)]
    assert found(parts, "m") == []
    assert parts.outputs("m") == set()


def test_packets_of_several_keys(tmp_path):
    """Each key has its own rows of a packet's tables, and none of a table that it has no rows of.

    Outputs that were computed later under the same key stand beside the first ones; a repetition counts once.
    """
    one, two = pa.table({"x": [1.0]}), pa.table({"x": [2.0, 3.0]})
    many = Packet.of([("k", ["a@1"]), ("l", ["a@1"]), ("m", ["a@1"])], [{"errors": one}, {}, {"errors": two}])
    parts = stored(tmp_path, many)
    assert [found(parts, key) for key in "klm"] == [[(("a@1",), [1.0])], [], [(("a@1",), [2.0, 3.0])]]
    assert parts.outputs("l") == {"a@1"}
    stored(tmp_path, packet("k", ("b@1",), value=2.0), packet("k", value=3.0))
    parts = opened(tmp_path)
    assert parts.outputs("k") == {"a@1", "b@1"}
    assert sorted(outputs for outputs, _ in found(parts, "k")) == [("a@1",), ("b@1",)]


@pytest.mark.parametrize("harm", ["torn", "flipped", "empty", "longer", "header"])
def test_damage_is_found(tmp_path, harm):
    """A damaged file is named and set aside; the others are used."""
    stored(tmp_path, packet("k"))
    (path,) = (tmp_path / "parts").iterdir()
    stored(tmp_path, packet("l"))
    data = bytearray(path.read_bytes())
    if harm == "flipped":
        data[-9] ^= 4
    elif harm == "header":
        data[12] ^= 1
    changed = {"torn": data[: len(data) // 2], "empty": b"", "longer": data + b"0"}.get(harm, data)
    path.write_bytes(changed)
    looked = opened(tmp_path, set_aside=False)
    assert looked.damaged == [path.name]
    assert path.exists()
    parts = opened(tmp_path)
    assert parts.damaged == [path.name]
    assert [p.name for p in (tmp_path / "parts" / DAMAGED).iterdir()] == [path.name]
    assert not path.exists()
    assert parts.outputs("k") == set()
    assert found(parts, "l")


@pytest.mark.parametrize("text", ["", "x", "\n", "[]\n", "{}\n", '{"format": 5}\n', "[" * 100_000 + "\n"], ids=len)
def test_a_file_of_another_program(tmp_path, text):
    """A file that is named by its digest, but has not the header that this program writes, is set aside too."""
    (tmp_path / "parts").mkdir()
    name = f"units-{hashlib.sha256(text.encode()).hexdigest()}.part"
    (tmp_path / "parts" / name).write_text(text, newline="")
    assert opened(tmp_path).damaged == [name]
    assert (tmp_path / "parts" / DAMAGED / name).exists()


def test_a_folder_is_no_part(tmp_path):
    """A folder with the name of a part is left alone."""
    (tmp_path / "parts" / f"units-{'0' * 64}.part").mkdir(parents=True)
    parts = opened(tmp_path)
    assert (parts.count, parts.damaged) == (0, [])
    parts.remove()
    assert len(list((tmp_path / "parts").iterdir())) == 1


def test_other_formats(tmp_path, monkeypatch, clock):
    """Files of a newer program are refused; those of an older one are not used, and removed with the others.

    Their rows are computed again, so their seconds, software and note are not those of the run.
    """
    parts = Parts(tmp_path, "units", {"study": "0"})
    parts.note = "an earlier run"
    clock[0] = 1000.0
    parts.add(packet("k"))
    parts.commit()
    monkeypatch.setattr(module, "FORMAT", FORMAT - 1)
    with pytest.raises(RunError, match="made by a newer version of this program"):
        opened(tmp_path)
    monkeypatch.setattr(module, "FORMAT", FORMAT + 1)
    later = opened(tmp_path)
    assert (later.count, later.seconds, later.made_by, later.note, later.outputs("k")) == (0, 0.0, [], "", set())
    later.remove()
    assert not (tmp_path / "parts").exists()


def test_small_packets_wait_for_each_other(tmp_path, monkeypatch):
    """A file is written when enough bytes wait; the rest is written in the end."""
    size = len(packet("k").data)
    monkeypatch.setattr(module, "_BYTES", 10 * size)
    parts = Parts(tmp_path, "units")
    for i in range(25):
        parts.add(packet(f"k{i}"))
        assert parts.count == (i + 1) // 10
    parts.commit()
    assert opened(tmp_path).count == 3
    assert all(found(parts, f"k{i}") for i in range(25))


def test_time_between_files_grows_with_the_run(tmp_path, monkeypatch, clock):
    """Packets wait a hundredth of the run's time, a second at least: the number of files grows with its logarithm."""
    monkeypatch.setattr(module, "write", lambda path, data: None)  # 500 files, each synced, would take a while
    parts = Parts(tmp_path, "units")
    assert parts.patience() is None
    counts = {}
    for tick in range(1, 5_000):
        clock[0] = tick
        parts.add(packet(f"k{tick}"))
        counts[tick] = parts.count
    assert counts[50] == 50
    assert 95 <= counts[100] <= 100
    assert counts[4_999] < 600


def test_kinds_do_not_mix(tmp_path):
    """Units and chains lie in the same folder; each is read and removed by itself."""
    parts = stored(tmp_path, packet("k"))
    other = Parts(tmp_path, "chains")
    other.add(packet("k", value=5.0))
    other.commit()
    parts.remove()
    assert opened(tmp_path).count == 0
    assert len(list((tmp_path / "parts").iterdir())) == 1
    other.remove()
    assert not (tmp_path / "parts").exists()


def test_software_that_computed_some_of_the_rows(tmp_path):
    """Other software is named once, also that of rows that were taken from another run; this one is not."""
    parts = stored(tmp_path, packet("k"))
    assert parts.made_by == []
    parts.sources = [{"study": "2"}, {"study": "1"}, {"study": "2"}]
    parts.add(packet("l"))
    parts.commit()
    assert parts.made_by == opened(tmp_path).made_by == [{"study": "2"}]
    other = Parts(tmp_path, "units", {"study": "3"})
    other.load()
    assert sorted(software["study"] for software in other.made_by) == ["1", "2"]


def robust(top=None, **design):
    """A study of a dear estimator and a cheap one, and a batch of its first cells' trials 3 to 402."""
    made = parse(config({"estimators": ["robust", "gdke"]} | (top or {}), samples=100, **design))
    return made, Batch(next(iter(made.groups())), 3, 403)


@pytest.mark.usefixtures("small_units")
def test_what_a_task_weighs():
    """Samples are drawn once and fitted at each level; blocks, rows and dear fits have the costs that are stated.

    Trials 3 to 9 lie in three blocks of four. Radii of one σ/r share a level: six cells are three levels.
    """
    made, _ = robust(trials=10, radius=[1.0, 10.0], noise=None, noise_over_radius=[0.01, 0.1, 0.3])
    (group,) = made.groups()
    draws, levels, samples, trials, (fit, point) = 7 * 100, 3, 7 * 100, 7, module._DEAR["robust"]
    expected = draws + levels * samples + (1 + levels) * 3 * module._OVERHEAD
    expected += 2 * 6 * trials * module._ROW + levels * trials * fit + levels * samples * point
    assert Layout(made).task(Batch(group, 3, 10)).weight == expected
    assert not takes_long(made)
    assert takes_long(robust(trials=10_000)[0])


def test_a_dear_unit_is_cut_by_trials():
    """Its pieces are its trials, once and in order, alike to one trial; each weighs half of the limit to all of it.

    No piece is less than a trial. A random design, whose trials draw their numbers of samples, is cut for the largest.
    """
    made, batch = robust(trials=403, noise=[0.1, 0.2])
    weight = Layout(made).task(batch).weight
    assert weight > 3 * module._PIECE
    pieces = list(shorter(made, batch))
    assert [(piece.first, piece.last) for piece in (pieces[0], pieces[-1])] == [
        (3, pieces[0].last),
        (pieces[-1].first, 403),
    ]
    assert all(one.last == other.first for one, other in pairwise(pieces))
    assert np.ptp([piece.trials for piece in pieces]) <= 1
    assert all(0.5 < Layout(made).task(piece).weight / module._PIECE < 1.02 for piece in pieces)
    few = Batch(batch.group, 3, 103)  # two levels of 100 trials at 2e5 each
    assert list(shorter(made, few)) == [few]
    huge = parse(config({"estimators": ["robust"]}, samples=60_000, trials=3))
    assert [piece.trials for piece in shorter(huge, next(iter(huge.units())))] == [1, 1, 1]
    wide = parse(config({"estimators": ["robust"]}, kind="random", trials=400, samples=log_uniform(4, 2000)))
    unit = Batch(next(iter(wide.groups())), 0, 400)
    assert len(list(shorter(wide, unit))) > 1
    cheap = parse(config({"estimators": ["gdke"]}, samples=60_000, trials=3))
    assert list(shorter(cheap, unit)) == [unit]


def test_a_dear_unit_of_a_summary_is_cut_by_levels():
    """Each piece has all trials; its cells are some levels, whole, and every level is in one piece."""
    made, batch = robust(
        {"keep": "summary"}, trials=403, radius=[1.0, 10.0], noise=None, noise_over_radius=[0.01, 0.1, 0.3]
    )
    pieces = list(shorter(made, batch))
    assert [(piece.first, piece.last) for piece in pieces] == [(3, 403)] * 3
    cells = [cell for piece in pieces for cell in piece.cells]
    assert len(cells) == len(set(cells)) == 6
    assert set(cells) == set(batch.cells)
    assert all(len({round(cell.noise / cell.radius, 9) for cell in piece.cells}) == 1 for piece in pieces)


GROWN = {
    "trials": {"trials": 23},
    "trials within a block": {"trials": 11},
    "cells": {"noise": [0.01, 0.05, 0.5]},
    "both": {"noise": [0.01, 0.05, 0.5], "trials": 23, "angle": [30, 60, 180]},
    "nothing": {},
}


@pytest.mark.usefixtures("small_units")
@pytest.mark.parametrize("case", list(GROWN))
def test_a_study_that_grew_has_the_tasks_of_the_earlier_one(make_text, case, tmp_path):
    """Its pieces hold each cell and trial once; those that the earlier study has are its very tasks, by their keys."""
    base = {"trials": 10, "noise": [0.05, 0.5]}
    earlier, later = parse(make_text(**base)), parse(make_text(**base | GROWN[case]))
    pieces = list(Layout(later, earlier).pieces())
    places = [(cell, trial) for piece in pieces for cell in piece.cells for trial in range(piece.first, piece.last)]
    assert len(places) == len(set(places)) == later.cells() * later.design.trials
    assert all(piece.trials > 0 for piece in pieces)
    keys, before = (
        {Layout(one).task(piece).key for piece in of}
        for one, of in ((later, pieces), (earlier, Layout(earlier).pieces()))
    )
    assert before <= keys
    assert (before == keys) == (case == "nothing")
    nothing = Parts(tmp_path, "units")
    assert [task.batch for task in Layout(later, earlier).missing(nothing)] == pieces
    for other in ({"seed": 2}, {"dimension": 2}):
        strange = parse(make_text(other, **base))
        assert list(Layout(later, strange).pieces()) == list(Layout(later).pieces())
        assert not before & {Layout(strange).task(piece).key for piece in Layout(strange).pieces()}


@pytest.mark.usefixtures("small_units")
def test_rows_are_put_in_the_order_of_a_whole_unit(make_text):
    """Rows of errors, points and summaries that were shuffled come back as the unit computes them."""
    rng = np.random.default_rng(1)
    top = {"estimators": ["lls", "gdke"], "keep_points": 9}
    for keep in ("errors", "summary"):
        made = parse(make_text(top | ({"keep": keep, "keep_points": 0} if keep == "summary" else {}), trials=9))
        unit = next(unit for unit in made.units() if unit.trials > 4)
        columns = schemas.of_units(*made.columns())
        filled = tables(made, compute(made, unit))
        names = ("errors", "points") if keep == "errors" else ("summary",)
        for name in names:
            table = schemas.table(columns[name], filled[name])
            row = np.arange(len(table))  # the points of a trial stay together
            part = table.to_pandas().groupby(["cell", "trial"], observed=True).ngroup() if name == "points" else row
            shuffled = table.take(np.argsort(rng.permutation(len(table))[part], kind="stable"))
            assert shuffled.num_rows > 3
            back = shuffled.take(order(made.estimators, unit, shuffled))
            pd.testing.assert_frame_equal(back.to_pandas(), table.to_pandas(), check_exact=True)
