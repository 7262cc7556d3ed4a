"""The claims of section 9.1 on recordings and the power law: tables made by hand, and what they say of joints.

Read stored case studies: the rows that count, and one line for a missing, a damaged or another table.
"""

import math

import numpy as np
import pandas as pd
import pytest

from study.files import InputError
from study.fits import Status
from study.recordings.recording import digest_of, with_origin
from study.simulation.claims.claim import Verdict
from study.simulation.claims.recordings import read_case_studies

FEW, MANY = (50, 200), (500, 1000)

NEAR, FAR = 0.002, 0.05


def spreads(upto, above, recordings=1):
    """Spreads of joints (metres), a list for up to 200 samples and one for above, alike in all recordings."""
    rows = [
        {"recording": r, "joint": f"joint {j}", "samples": n, "spread": s, "with_axes": s, "error": 2.0 * s}
        for r in range(recordings)
        for values, sizes in ((upto, FEW), (above, MANY))
        for j, s in enumerate(values)
        for n in sizes
    ]
    return pd.DataFrame(rows).assign(doubted=False)


@pytest.fixture
def judged(find):
    """The claim's finding by a table of spreads."""
    return lambda table: find("recordings-within-1-cm", {}, recordings=table)


@pytest.mark.parametrize(
    ("upto", "above", "verdict"),
    [
        ([FAR] * 14, [NEAR] * 14, Verdict.REPRODUCED),
        ([FAR] * 14, [NEAR] * 12 + [FAR, math.inf], Verdict.REPRODUCED),
        ([NEAR] * 14, [NEAR] * 14, Verdict.REPRODUCED),
        (
            [FAR] * 14,
            [NEAR] * 8 + [FAR] * 6,
            Verdict.REPRODUCED,
        ),  # more than half: the error of the share says how surely
        ([FAR] * 14, [NEAR] * 6 + [FAR] * 8, Verdict.NOT_REPRODUCED),
        ([FAR] * 14, [FAR] * 14, Verdict.NOT_REPRODUCED),
    ],
)
def test_verdicts(judged, upto, above, verdict):
    """More than half of the joints at each number of samples above 200; fewer samples do not count."""
    found = judged(spreads(upto, above))
    assert found.verdict is verdict
    share, gain = found.numbers[1:3]
    assert share.value == pytest.approx(np.mean(np.array(above) < 0.01))
    assert gain.value == pytest.approx(share.value - np.mean(np.array(upto) < 0.01))
    assert "14 joints of 1 recording " in share.words


@pytest.mark.parametrize(("doubted", "share"), [(0, 1.0), (2, 1.0), (8, 0.0), (14, 0.0)])
def test_joints_in_doubt_carry_no_verdict(judged, doubted, share):
    """Spreads of joints whose own errors are in doubt are shown, but the claim is not reproduced by them."""
    table = spreads([FAR] * 14, [NEAR] * 14)
    table["doubted"] = table["joint"].isin([f"joint {j}" for j in range(doubted)])
    found = judged(table)
    assert found.numbers[0].value == share
    assert found.numbers[1].value == 1.0
    assert found.numbers[3].value == pytest.approx(1 - doubted / 14)


def test_a_share_of_its_spreads(judged):
    """A joint that is near at one of two numbers of samples counts half; a spread of a centimetre is not below it."""
    table = spreads([FAR] * 10, [NEAR] * 10)
    table.loc[table["samples"] == 500, "spread"] = 0.01
    found = judged(table)
    assert found.numbers[1].value == pytest.approx(0.5)


def test_errors_count_joints(judged):
    """More rows of the same joints, or more recordings of them, make no error smaller; more joints do."""
    upto, above = [FAR] * 9 + [NEAR], [NEAR] * 9 + [FAR]
    once = judged(spreads(upto, above))
    table = spreads(upto, above)
    rows = pd.concat([table, table[table["samples"] == 1000].assign(samples=2000)])
    twice, thrice = judged(spreads(upto, above, recordings=3)), judged(rows)
    for other in (twice, thrice):
        for one, same in zip(once.numbers[1:], other.numbers[1:], strict=True):
            assert same[1:] == pytest.approx(one[1:])
        assert other.verdict is once.verdict is Verdict.REPRODUCED
    assert "10 joints of 3 recordings " in twice.numbers[1].words
    assert {n.trials for n in once.numbers[1:]} == {10}
    adjusted = (9 + 2) / (10 + 4)
    assert once.numbers[1].error == pytest.approx(math.sqrt(adjusted * (1 - adjusted) / 14))
    assert judged(spreads(2 * upto, 2 * above)).numbers[1].error < once.numbers[1].error


def test_case_studies_of_one_recording_are_pooled(judged):
    """Case studies of one recording with other seeds are averaged, in any order, and count as one recording."""
    one, other = spreads([FAR] * 8, [NEAR] * 8), spreads([FAR] * 8, [NEAR] * 4 + [FAR] * 4)
    for tables in ([one, other], [other, one]):
        found = judged(pd.concat(tables, ignore_index=True))
        assert found.numbers[1].value == pytest.approx(0.75)
        assert found.numbers[1].trials == 8
        assert "8 joints of 1 recording " in found.numbers[1].words


def test_a_long_recording_counts_no_more(judged):
    """Recordings count alike, whatever the numbers of samples that they have room for."""
    table = spreads([FAR] * 6, [NEAR] * 6, recordings=2)
    table.loc[table["recording"] == 1, "spread"] = FAR
    short = (table["recording"] == 1) & (table["samples"] == 1000)
    assert judged(table[~short]).numbers[1].value == pytest.approx(0.5)


def test_a_short_recording_says_nothing(judged):
    """A recording without large subsets is not counted, and does not raise the share of other recordings' joints."""
    table = spreads([FAR] * 6, [NEAR] * 6, recordings=2)
    table.loc[table["recording"] == 1, "spread"] = NEAR
    found = judged(table[(table["recording"] == 0) | (table["samples"] <= 200)])
    assert [n.value for n in found.numbers[1:3]] == [1.0, 1.0]
    assert "6 joints of 1 recording " in found.numbers[1].words
    assert found.numbers[1].words.endswith(" (too short, so without a say: recordings whose subsets reach 200 frames)")


def test_what_is_shown_besides(judged):
    """The whole answer's own error, and the axes of hinges, enter numbers of their own and no verdict."""
    table = spreads([FAR] * 10, [0.006] * 10).assign(with_axes=FAR)
    found = judged(table)
    assert [n.value for n in found.numbers[1:]] == [1.0, 1.0, 1.0, 0.0, 0.0]
    assert found.verdict is Verdict.REPRODUCED


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (spreads([FAR] * 4, [NEAR] * 4), "share of 4 joints of 1 recording"),
        (spreads([FAR] * 14, []), "share of 0 joints of 0 recordings with a spread below 1 cm, above 200 samples ("),
        (spreads([], [NEAR] * 14), "up to 200 samples, joint by joint (needs 5 joints)"),
    ],
)
def test_too_few(judged, table, words):
    """Four joints that are all alike are chance as often as not in 20; a short recording has no large subset."""
    found = judged(table)
    assert found.verdict is Verdict.NOT_EVALUATED
    assert words in found.reason


def hinged(hinges, others):
    """Spreads of six hinges and eight other joints with all axes, at 400 samples."""
    rows = [
        {"joint": f"{kind}{i}", "with_axes": 0.02 if i < far else 0.005, "hinge": kind == "h"}
        for kind, count, far in (("h", 6, hinges), ("o", 8, others))
        for i in range(count)
    ]
    return pd.DataFrame(rows).assign(recording="a", samples=400, spread=0.005, error=0.005, doubted=False)


@pytest.mark.parametrize(
    ("hinges", "others", "verdict"),
    [(6, 0, Verdict.REPRODUCED), (2, 2, Verdict.IN_PART), (1, 4, Verdict.NOT_REPRODUCED)],
)
def test_two_answers(find, hinges, others, verdict):
    """Hinges that scatter by more than a centimetre, beside the other joints."""
    found = find("two-answers", {}, recordings=hinged(hinges, others))
    assert found.verdict is verdict
    assert [n.value for n in found.numbers[1:]] == pytest.approx([hinges / 6, others / 8, 4.0 if hinges > 3 else 1.0])


def test_too_few_hinges(find):
    """Two hinges say nothing."""
    table = hinged(6, 0)
    found = find("two-answers", {}, recordings=table[~table["joint"].isin(["h2", "h3", "h4", "h5"])])
    assert found.verdict is Verdict.NOT_EVALUATED


NAME = "case-study-scatter.parquet"
VERSION = "written by another version"


def scatter(**changes):
    """A joint, and a hinge whose axis was dropped, with two numbers of random frames and one of consecutive ones."""
    rows = [
        ("neck", "random", False, 100, 0.004, 0.005),
        ("neck", "random", False, 500, 0.002, 0.004),
        ("neck", "window", False, 500, 0.040, 0.040),
        ("knee", "random", False, 100, math.inf, math.inf),
        ("knee", "random", False, 500, 0.030, 0.031),
        ("knee", "random", True, 100, 0.003, 0.006),
        ("knee", "random", True, 500, 0.001, 0.005),
    ]
    table = pd.DataFrame(rows, columns=["joint", "way", "dropped", "samples", "median", "error"])
    return with_origin(table, "walk", "0123456789ab").assign(**changes)


@pytest.fixture
def folder(tmp_path):
    """Store a table as a case study's, in a folder of this name."""

    def make(table, name="study"):
        (tmp_path / name).mkdir()
        table.to_parquet(tmp_path / name / NAME)
        return tmp_path / name

    return make


def test_rows(folder):
    """Random frames alone count; a hinge counts without its axis, and has the scatter with it in another column."""
    found = read_case_studies([folder(scatter())]).set_index(["joint", "samples"])
    assert len(found) == 4
    assert set(found["recording"]) == {"0123456789ab"}
    spreads = {("neck", 100): 0.004, ("neck", 500): 0.002, ("knee", 100): 0.003, ("knee", 500): 0.001}
    assert found["spread"].to_dict() == spreads
    assert found.loc[("knee", 100), "with_axes"] == math.inf
    assert found.loc[("knee", 500), "with_axes"] == 0.03
    assert found.loc[("knee", 500), "error"] == 0.005
    assert found.loc[("neck", 500), "with_axes"] == 0.002


@pytest.mark.parametrize(("stored", "doubted"), [({}, True), ({"doubted": False}, False), ({"doubted": True}, True)])
def test_doubts(folder, stored, doubted):
    """A table of before doubts were stored rests on errors without skin, so that all its joints are in doubt."""
    assert (read_case_studies([folder(scatter(**stored))])["doubted"] == doubted).all()


def test_several(folder):
    """The digest of the file tells recordings apart, not its name."""
    one, seed = folder(scatter(), "a"), folder(scatter(median=0.3, recording="copy"), "b")
    other = folder(scatter(median=0.5, digest="ba9876543210"), "c")
    found = read_case_studies([one, seed, other])
    assert found.groupby("recording")["spread"].max().to_dict() == {"0123456789ab": 0.3, "ba9876543210": 0.5}
    assert len(found) == 12


def test_digest(tmp_path):
    """The digest has twelve digits of SHA-256 (of "abc", FIPS 180-4 example); a byte changes it, a name does not."""
    for name, content in (("a", b"abc"), ("b", b"abc"), ("c", b"abd")):
        (tmp_path / name).write_bytes(content)
    assert digest_of(tmp_path / "a") == digest_of(tmp_path / "b") == "ba7816bf8f01"
    assert digest_of(tmp_path / "c") != digest_of(tmp_path / "a")
    with pytest.raises(InputError, match="none: cannot be read: No such file"):
        digest_of(tmp_path / "none")


@pytest.mark.parametrize("lacking", [["digest"], ["recording", "digest"]])
def test_tables_that_do_not_name_their_recording(folder, lacking):
    """A table without its origin gives one line with the folder and the remedy."""
    place = folder(scatter().drop(columns=lacking))
    with pytest.raises(InputError) as caught:
        read_case_studies([place])
    said = str(caught.value)
    assert said.startswith(f"{place}: a case study that does not name its recording: {NAME} has no columns recording")
    assert said.endswith(f"run the case study again: `study case-study FILE --out {place}`")
    assert "\n" not in said


def test_a_table_of_two_recordings(folder):
    """A table of two recordings is refused."""
    table = pd.concat([scatter(), scatter(digest="ba9876543210", joint="hip")], ignore_index=True)
    with pytest.raises(InputError, match="of 2 recordings, not of one; run the case study again"):
        read_case_studies([folder(table)])


def test_one_twice(folder):
    """The same case study is refused twice, also from another folder."""
    first, second = folder(scatter(), "a"), folder(scatter(), "b")
    for folders in ([first, first], [first, second]):
        with pytest.raises(InputError, match="the same case study; give it once"):
            read_case_studies(folders)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (scatter().drop(columns=["median", "error"]), f"{VERSION}: median, error missing or of another type"),
        (scatter(samples="many"), f"{VERSION}: samples missing"),
        (scatter(dropped=1.0), f"{VERSION}: dropped missing"),
        (scatter(way="window"), "not one row per joint"),
        (scatter(samples=100), "not one row per joint"),
    ],
)
def test_other_tables(folder, table, words):
    """A table of another version or another program is refused."""
    place = folder(table)
    with pytest.raises(InputError) as caught:
        read_case_studies([place])
    assert str(caught.value).startswith(f"{place / NAME}: {words}")
    assert str(caught.value).endswith(f"`study case-study FILE --out {place}` writes one")


SAMPLES = [30, 100, 300, 1000, 3000]


@pytest.fixture
def grid(error_rows, scores):
    """Errors ∝ n^e for exponents e of each estimator, with the same spread at each n."""

    def make(**exponents):
        spread = np.exp(0.3 * scores(400))
        rows = [error_rows(name, spread * float(n) ** e, samples=n) for name, e in exponents.items() for n in SAMPLES]
        return pd.concat(rows)

    return make


@pytest.mark.parametrize(
    ("exponent", "verdict"),
    [
        (-0.5, Verdict.REPRODUCED),
        (-0.45, Verdict.IN_PART),
        (-1.0, Verdict.IN_PART),  # one N of five, the middle one
        (0.0, Verdict.IN_PART),
    ],
)
def test_power_law(find, grid, exponent, verdict):
    """UGDK's error times √N within 10 % of its median decides, at N from 40 to 320; exponents are shown."""
    found = find("power-law", {"power-law/errors": grid(ugdk=exponent, mle=-0.5, gdke=0.0)})
    assert [n.value for n in found.numbers[1:]] == pytest.approx([exponent, -0.5, 0.0], abs=1e-9)
    assert found.numbers[1].trials == 400
    assert found.verdict is verdict


def test_failures_count(find, grid):
    """Fits without a number raise the medians at the largest N; where most have none, the error falls with nothing.

    A status alone changes nothing.
    """
    errors = grid(ugdk=-0.5)
    for share in (0.4, 0.6):
        failed = (errors["samples"] >= 1000) & (errors["trial"] % 10 < 10 * share)
        table = errors.assign(status=np.where(failed, Status.NOT_POSITIVE_DEFINITE, Status.OK))
        assert find("power-law", {"power-law/errors": table}).verdict is Verdict.REPRODUCED
        table = table.assign(error=table["error"].where(~failed))
        found = find("power-law", {"power-law/errors": table})
        assert found.numbers[1].value > -0.5
        assert found.numbers[0].value < 1.0


def test_two_numbers_of_samples_are_no_law(find, grid):
    """A line through two points fits always."""
    errors = grid(ugdk=-0.5)
    found = find("power-law", {"power-law/errors": errors[errors["samples"] <= 100]})
    assert found.verdict is Verdict.NOT_EVALUATED
