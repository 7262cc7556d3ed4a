"""From a recording to the verdict on it: a synthetic body, its case study, and the claims that it is given to."""

import shutil

import pandas as pd
import pytest

from study.mocap.io.origin import digest_of

BAD = "case-study-scatter.parquet"


@pytest.fixture(scope="module")
def folder(finished, call, tmp_path_factory):
    """A folder with a finished run in ``out`` and the case study of a short synthetic body in ``body``."""
    place = tmp_path_factory.mktemp("recording")
    shutil.copytree(finished[0] / "out", place / "out")
    said = call(place, "synthetic", "--frames", "2000", "--noise", "0.002", "--gaps", "0.05", "--out", "body.c3d")
    assert (said[0], said[2]) == (0, "")
    shutil.copy(place / "body.c3d", place / "copy.c3d")
    for file, seed, out in (("body.c3d", "1", "body"), ("copy.c3d", "2", "again")):
        said = call(place, "case-study", file, "--subsets", "20", "--seed", seed, "--out", out)
        assert (said[0], said[2]) == (0, "")
    return place


def of_recordings(said):
    """The lines of the last claim that `study claims` printed."""
    lines = said.splitlines()
    return lines[next(i for i, line in enumerate(lines) if line.startswith("23 ")) : -1]


def test_claims(call_here, folder):
    """With the recording there is a verdict on its joints, which are near with few samples, too: the claim in part."""
    code, said, complained = call_here(folder, "claims", "out", "--recording", "body")
    assert (code, complained) == (0, "")
    head, *numbers = of_recordings(said)
    assert "PARTLY" in head
    assert numbers[0].startswith("    share of 14 joints of 1 recording with a spread below 1 cm, ")
    assert "above 200 samples: 1 ± 0.07" in numbers[0]
    assert numbers[1].endswith("joint by joint: 0")


def test_one_recording_twice(call_here, folder):
    """Two seeds on one recording, were it copied, are one recording; the tables say which."""
    code, said, complained = call_here(folder, "claims", "out", "--recording", "body", "--recording", "again")
    assert (code, complained) == (0, "")
    assert of_recordings(said)[1].startswith("    share of 14 joints of 1 recording with a spread below 1 cm, ")
    for name in ("scatter", "joints", "laws"):
        body, again = (pd.read_parquet(folder / out / f"case-study-{name}.parquet") for out in ("body", "again"))
        assert set(body["recording"]) == {"body"}
        assert set(again["recording"]) == {"copy"}
        assert set(body["digest"]) == set(again["digest"]) == {digest_of(folder / "body.c3d")}


def test_claims_without(call_here, folder):
    """Without it the line names the command that would give it."""
    code, said, _ = call_here(folder, "claims", "out")
    assert code == 0
    head, reason = of_recordings(said)
    assert "NOT EVALUATED" in head
    assert reason == "    needs a recording: `study case-study FILE --out DIR`, then `--recording DIR` here"


def test_report(call_here, folder):
    """The page has the verdict, too, and says on how many joints it rests; without the recording what would give it."""
    for options, words in (
        (["--recording", "body"], ["share of 14 joints of 1 recording", "at least 14 behind each number"]),
        ([], ["<code>study case-study</code> writes, given by <code>--recording</code>"]),
    ):
        assert call_here(folder, "report", "out", *options, "--out", "page.html")[0] == 0
        page = (folder / "page.html").read_text(encoding="utf-8")
        assert all(word in page for word in words)


@pytest.mark.parametrize("verb", ["claims", "report"])
def test_refusals(call_here, folder, verb):
    """A folder without a case study, a damaged table, one given twice: code 2 and one line."""
    (folder / "bad").mkdir(exist_ok=True)
    (folder / "bad" / BAD).write_bytes(b"not parquet")
    for given, words in (
        (
            ["none"],
            "none: not the folder of a case study, as it has no case-study-scatter.parquet; `study case-study FILE",
        ),
        (["bad"], f"bad/{BAD}: cannot be read"),
        (["body", "body"], "body and body: the same case study"),
    ):
        options = [word for name in given for word in ("--recording", name)]
        code, said, complained = call_here(folder, verb, "out", *options)
        assert (code, said) == (2, "")
        assert complained.startswith(words)
        assert complained.count("\n") == 1
