"""`study ask`: a line for each estimator, the same as JSON, and refusals that name the range."""

import json

import pytest

ASKED = ["ask", "--samples", "50", "--noise-over-radius", "0.1", "--angle", "40"]


def test_lines(well, tmp_path):
    """The condition, a row per estimator from the best to the worst, the bound's row, and where the table is from."""
    heading, titles, *rows, bound, origin = well(tmp_path, *ASKED).splitlines()
    assert heading == "N = 50, σ/r = 0.1, φ = 40°: median error of the centre over the bound"
    assert titles.split() == ["median", "95", "%", "from", "to"]
    medians = [float(row.split()[1]) for row in rows]
    assert medians == sorted(medians)
    for row in rows:
        _, value, low, high = row.split()
        assert float(low) <= float(value) <= float(high)
    assert bound.startswith("at the bound")
    assert "20,000 trials" in origin


def test_json(well, tmp_path):
    """One object with the condition, the level, the answers and their origin."""
    told = json.loads(well(tmp_path, *ASKED, "--json"))
    assert list(told) == ["samples", "noise_over_radius", "angle", "level", "at_bound", "answers", "made_by"]
    assert (told["samples"], told["noise_over_radius"], told["angle"], told["level"]) == (50, 0.1, 40.0, 0.95)
    assert {"corrected", "mle", "gdke"} <= {answer["estimator"] for answer in told["answers"]}
    assert set(told["answers"][0]) == {"estimator", "ratio_median", "low", "high"}


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (("--angle", "5"), "angle 5: the table reaches from 8 to 180; run a study instead"),
        (("--samples", "3000"), "samples 3000: the table reaches from 8 to 2000; run a study instead"),
        (("--dimension", "2"), "dimension 2: the table is of spheres in 3; run a study instead"),
    ],
)
def test_beyond_the_table(call_here, tmp_path, option, words):
    """Exit code 2, nothing printed, and the range on standard error."""
    code, said, complained = call_here(tmp_path, *ASKED, *option)
    assert (code, said) == (2, "")
    assert words in complained
