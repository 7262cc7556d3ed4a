"""Part files: rows are read as they were written, damage is found, and many packets share a file."""

import hashlib
from types import SimpleNamespace

import pyarrow as pa
import pytest

from study.files import RunError
from study.simulation.runs import parts as module
from study.simulation.runs.parts import DAMAGED, FORMAT, Packet, Parts


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
    monkeypatch.setattr(module, "write", lambda path, data: None)  # 800 files, each synced, would take a while
    parts = Parts(tmp_path, "units")
    assert parts.patience() is None
    counts = {}
    for tick in range(1, 20_000):
        clock[0] = tick
        parts.add(packet(f"k{tick}"))
        counts[tick] = parts.count
    assert counts[50] == 50
    assert 95 <= counts[100] <= 100
    assert counts[19_999] < 800


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
