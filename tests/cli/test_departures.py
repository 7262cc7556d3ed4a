"""Noise that is not normal, on the command line: every text that has the bound names its law."""

import pytest

TOP = """name = "laws"
seed = 1
estimators = ["gdke", "als"]
[design]
kind = "grid"
trials = 5
samples = 20
noise = 0.05
angle = 90
"""
MORE = 'law = ["normal", "student(3)"]\noutlier_share = [0, 0.2]\n'
WORDS = "Gaussian bound at the same σ"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a config of other noise and one of normal noise."""
    folder = tmp_path_factory.mktemp("laws")
    (folder / "laws.toml").write_text(TOP + MORE, encoding="utf-8")
    (folder / "plain.toml").write_text(TOP, encoding="utf-8")
    return folder


def test_every_text_names_the_law(call_here, folder):
    """Summary, worst trials, replayed trials and the report say of which noise the bound is, where it is not plain."""
    for name, expected in (("laws", True), ("plain", False)):
        assert call_here(folder, "run", f"{name}.toml", "--out", name)[0] == 0
        for command in ("summary", "worst"):
            code, said, _ = call_here(folder, command, name)
            assert code == 0
            assert (WORDS in said) == expected
        trials = [line.split()[0] for line in said.splitlines() if "/" in line.split(" ")[0]]
        replayed = [call_here(folder, "replay", name, trial)[1] for trial in trials]
        assert len(replayed) == (10 if expected else 5)
        for text in replayed:
            departs = "law = student(3)" in text or "outliers = 0.2" in text
            assert (f"  {WORDS}: " in text) == departs
            assert ("  bound: " in text) == (not departs)
        assert call_here(folder, "report", name)[0] == 0
        page = (folder / name / "report.html").read_text(encoding="utf-8")
        assert (WORDS in page) == expected


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ('law = "cauchy"', "line 10: design.law = 'cauchy': 'cauchy' not allowed: every value must be normal, "),
        ("outlier_share = 1.5", "line 10: design.outlier_share = 1.5: 1.5 not allowed: every value must be a share"),
        ("outlier_size = 3", "line 10: design.outlier_size: has no effect without outlier_share"),
    ],
)
def test_refused(call_here, folder, entry, words):
    """What makes no sense is one line after the file's name, and nothing is written."""
    (folder / "wrong.toml").write_text(TOP + entry + "\n", encoding="utf-8")
    before = sorted(folder.iterdir())
    code, said, complained = call_here(folder, "run", "wrong.toml")
    assert (code, said) == (2, "")
    assert complained.splitlines()[0] == "wrong.toml: 1 fault"
    assert complained.splitlines()[1].startswith(f"  {words}")
    assert len(complained.splitlines()) == 2
    assert sorted(folder.iterdir()) == before
