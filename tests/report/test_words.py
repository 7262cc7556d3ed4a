import math

import pytest

from study.experiment.config import parse
from study.report import words
from study.statistics.performance import MEASURES


def plain(text):
    """With plain spaces."""
    return text.replace("\u00a0", " ").replace("\u202f", " ")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.0, "0"),
        (-1.23456, "−1.23"),
        (1234.0, "1.23 × 10³"),
        (100.0, "100"),
        (1e-9, "10⁻⁹"),
        (-1e-9, "−1 × 10⁻⁹"),
        (2.5e14, "2.5 × 10¹⁴"),
        (math.nan, "–"),
        (math.inf, "∞"),
        (-math.inf, "−∞"),
    ],
)
def test_number(value, expected):
    """Three digits, a long minus, powers of ten."""
    assert plain(words.number(value)) == expected


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (1.7, "1.70"),
        (34.0, "34.0"),
        (433.0, "433"),
        (5.0, "5.00"),
        (1.5e-8, "1.50 × 10⁻⁸"),
        (12345.6, "12 300"),
        (999.7, "1000"),
        (2e6, "2.00 × 10⁶"),
    ],
)
def test_timed(value, expected):
    """A measured number keeps the zeros at its end."""
    assert plain(words.timed(value)) == expected


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [
        (0.765232, 0.117134, "0.77 ± 0.12"),
        (29.39512, 0.03199, "29.395 ± 0.032"),
        (-1.5, 0.25, "−1.50 ± 0.25"),
        (1.23456e7, 1.2e5, "(1.235 ± 0.012) × 10⁷"),
        (1.23456e-5, 3e-7, "(1.235 ± 0.030) × 10⁻⁵"),
        (0.0, 0.012, "0 ± 0.012"),
        (48.2, 4692.0, "48 ± 4700"),
        (0.5, 0.52, "0.50 ± 0.52"),
        (-0.0003419, 0.0032, "−0.00034 ± 0.0032"),
        (0.8, 0.35, "0.80 ± 0.35"),
        (1.0, 0.00035, "1.00000 ± 0.00035"),
        (3e8, 4e9, "3.0 × 10⁸ ± 4.0 × 10⁹"),
        (0.123456789, 1e-12, "0.123457 ± 1.0 × 10⁻¹²"),
        (7.0, 0.0, "7"),
        (7.0, math.nan, "7"),
        (225.4, math.inf, "225 ± ∞"),
        (math.inf, math.nan, "∞"),
        (math.nan, math.nan, "–"),
    ],
)
def test_measured(value, error, expected):
    """Two digits of the error, the number to the same place, one power of ten for both."""
    assert plain(words.measured(value, error)) == expected


def test_a_number_breaks_before_its_error_alone():
    """Nowhere else may a line end within it."""
    assert words.measured(1.23456e7, 1.2e5).split(" ") == ["(1.235", "±\u00a00.012)\u00a0×\u00a010⁷"]
    assert words.count(1234567).split() == ["1", "234", "567"]
    assert " " not in words.count(1234567)


@pytest.mark.parametrize(
    ("part", "whole", "expected"), [(0, 9, "0 %"), (1, 9, "11.1 %"), (9, 9, "100 %"), (1, 9999, "< 0.1 %")]
)
def test_percent(part, whole, expected):
    """A share is rounded, but neither to none nor to all."""
    assert plain(words.percent(part, whole)) == expected
    assert plain(words.percent(9998, 9999)) == "> 99.9 %"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("bias: -1.2e-05 ± 3e-07", "bias: (−1.200 ± 0.030) × 10⁻⁵"),
        (
            "over LLS's, σ ≥ .1 r: 27.41 ± 5.1; N = 30: 0 ± 0.00035",
            "over LLS's, σ ≥ .1 r: 27.4 ± 5.1; N = 30: 0 ± 0.00035",
        ),
        ("at 1e+14: -3", "at 1 × 10¹⁴: −3"),
        ("run paper-8689e37964, 10-fold", "run paper-8689e37964, 10-fold"),
        ("in [0, 1]-free words", "in [0, 1]-free words"),
    ],
)
def test_readable(text, expected):
    """Numbers in a program's text become a reader's; names stay as they are."""
    assert plain(words.readable(text)) == expected


HEAD = 'name = "x"\nseed = 1\nestimators = ["mle"]\n'


@pytest.mark.parametrize(
    ("design", "expected"),
    [
        (
            'kind = "grid"\ntrials = 5\nsamples = 100000\nnoise = 0.125\nangle = 31.7',
            "one cell of 5 trials: N = 100 000; σ = 0.125; φ = 31.7°; r = 1; |c| = 0",
        ),
        (
            'kind = "grid"\ntrials = 5\nsamples = [5, 20]\nnoise_over_radius = { logspace = [1e-7, 1, 8] }\nangle = 90',
            "16 cells of 5 trials, all from the same draws: N = 5, 20; σ/r = 10⁻⁷, 10⁻⁶, 10⁻⁵, …, 1 (8 values); "
            "φ = 90°; r = 1; |c| = 0",
        ),
        (
            'kind = "random"\ntrials = 5\nsamples = { law = "log_uniform", low = 4, high = 1_000_000 }\nnoise = 1e-13\n'
            'angle = { law = "choice", values = [20, 45] }\nradius = { law = "uniform", low = 0, high = 37 }',
            "5 trials, each with conditions of its own: N log-uniform from 4 to 10⁶; σ = 10⁻¹³; "
            "φ one of 20°, 45°; r uniform from 0 to 37; |c| = 0",
        ),
    ],
    ids=["cell", "grid", "random"],
)
def test_design(design, expected):
    """A design in a sentence, with every quantity and its values as the config gives them."""
    assert plain(words.design(parse(f"{HEAD}[design]\n{design}"))) == expected


@pytest.mark.parametrize(
    ("value", "expected"), [(123456.0, "123 456"), (1234567.0, "1 234 567"), (1.25e8, "1.25 × 10⁸"), (0.1, "0.1")]
)
def test_exactly(value, expected):
    """No digit of a config's number is lost."""
    assert plain(words.exactly(value)) == expected


def test_every_measure_has_a_heading():
    """In words, no two alike, and short enough for a column."""
    titles = [measure.title for measure in MEASURES.values()]
    assert len(set(titles)) == len(titles)
    assert all("_" not in title and len(title) < 60 for title in titles)


def test_names_of_estimators_in_a_sentence():
    """A name that is an ordinary word is code; "use the estimator corrected" could be misread."""
    assert [words.estimator(name) for name in ("corrected", "robust", "mle", "taubin", "my_own")] == [
        "`corrected`",
        "`robust`",
        "MLE",
        "Taubin",
        "`my_own`",
    ]
