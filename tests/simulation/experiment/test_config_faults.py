"""Configs with faults: one message has every fault, with its line, place, value and the values allowed.

Any TOML at all is a study or a `ConfigError`, never anything else.
"""

import json
import math
import re

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from study.simulation.experiment.config import WITH_ERROR, Study, load, parse
from study.toml import ConfigError
from tests.configs import toml

GRID = """name = "test"
seed = 1
dimension = 3
estimators = ["mle", "ugdk"]
[design]
kind = "grid"
trials = 4000
samples = [10, 20]
noise = 0.1
angle = 90
radius = 1
"""
CELLS = GRID.replace("4000", "3").replace("[10,", "[5,").replace("noise = 0.1", "noise = [0.1, 0.2]")
CELLS = CELLS.replace("angle = 90\nradius = 1", "angle = [60, 180]\nradius = [1.0, 2.0]\ncenter = [0.0, 3.0]")
LAWS = CELLS[: CELLS.index("kind")] + (
    'kind = "random"\ntrials = 3\nsamples = { law = "log_uniform", low = 5, high = 40 }\n'
    'noise_over_radius = { law = "choice", values = [0.1, 0.3] }\n'
    'angle = { law = "uniform", low = 0, high = 180 }\nradius = 2.0\n'
)
BASES = {"g": GRID, "r": GRID.replace('"grid"', '"random"').replace("[10, 20]", "10"), "c": CELLS, "l": LAWS}
"""A small grid, a random design of plain numbers, a grid of several cells, and a random design of laws."""


def changed(base, edits):
    """A config with edits, each a line, and the number of the last one's line.

    A line stands in place of that of the same key, or of the key before ``>``, or first behind ``^``; others are added
    at the end.
    """
    lines = BASES[base].splitlines()
    for edit in edits.split("\n"):
        key, _, line = edit.partition(" > ") if " > " in edit else (edit.partition(" = ")[0], "", edit)
        places = [i for i, old in enumerate(lines) if old.partition(" = ")[0] == key.strip()]
        if edit.startswith("^"):
            lines.insert(0, edit[2:])
            number = 1
        elif places and "[posterior]" not in lines and "[precision]" not in lines:
            lines[places[0]] = line
            number = places[0] + 1
        else:
            lines.append(line)
            number = len(lines)
    return "\n".join(lines) + "\n", number


def faults(text):
    """Lines of the message about a text."""
    with pytest.raises(ConfigError) as caught:
        parse(text, "x.toml")
    head, *lines = str(caught.value).splitlines()
    assert head == ("x.toml: 1 fault" if len(lines) == 1 else f"x.toml: {len(lines)} faults")
    assert all(re.match(r"  line \d+: ", line) for line in lines)
    return lines


HUGE = "1" + 400 * "0"
HUGE_SHAPE = f"^ noise_shape = [[{HUGE}, 0, 0], [0, 1, 0], [0, 0, 1]]"
"""No matrix, and no row of numbers either: two faults."""
NAME = "small letters, digits and hyphens"
DEFINITE = "symmetric, positive definite 3 × 3"
NUMBER = "every value must be a number"
WHERE = "[posterior]\nwhere = "
WHOLE = "posterior.likelihood: whole_sphere is wrong on caps: choose cells of the whole sphere with where = { angle = "
FEW = "posterior.noise: an unknown noise needs at least 5 samples, not 4; choose with where"
TARGET = "[precision]\ntarget = 1.0\n"
MOMENTS = 'estimators = ["gdke"]\n^ route = "moments"'
SHAPED = "^ noise_shape = [[1, 0, 0], [0, 1, 0], [0, 0, 4]]"
MEMORY = "samples are too many for memory"
MANY_SAMPLES = ('"uniform", low = 5, high = 1e12', '"constant", value = 1e300', '"choice", values = [9, 1e10]')
MANY_CELLS = "design: 200,000,000 cells; at most 10,000,000 are allowed"
SINGULAR = [[[1, 2, 0], [0, 1, 0], [0, 0, 1]], [[26, 13, -23], [13, 13, -19], [-23, -19, 29]]]
"""A matrix that is not symmetric, and one that is singular but for rounding."""
BEYOND = [("trials", 0, 1), ("walkers", 7, 8), ("walkers", 5000, 4096), ("max_steps", 99, 100), ("keep_draws", -1, 0)]
BEYOND += [("max_steps", 20000000, 10000000), ("box", 2000.0, 1000)]
TWICE = [("noise", '["known", "known"]'), ("likelihood", '["geometric", "geometric"]')]
NO_NUMBERS = ['angle = "wide"', "angle = [180, true]", "noise = nan", "angle = { linspace = [60, 180, 2] }"]
NO_CELL = [("angle", 45, 45), ("samples", [20, 21], 21), ("noise", 0.1000001, 0.1000001), ("radius", 3, 3)]
NO_CELL += [("noise_over_radius", 0.15, 0.15), ("center", 1, 1), ("directions", '"polar"', "polar")]
CASES = [
    *(("gr", f"name = '{name}'", f"name = '{name}'", NAME) for name in ("../x", "..", "/tmp/x", "a/b", "", "a b")),
    ("gr", "name = 7", "name = 7", "string"),
    ("gr", "seed = -1", "seed = -1", "greater than or equal to 0"),
    ("gr", "seed = true", "seed = True", "integer"),
    ("gr", "^ bogus = 1", "bogus = 1", "unknown key; known are name, seed"),
    ("gr", "dimension = 1", "dimension = 1", "greater than or equal to 2"),
    ("gr", "^ keep_points = -1", "keep_points = -1", "greater than or equal to 0"),
    ("gr", "estimators = []", "estimators = []: must have a value"),
    ("gr", 'estimators = "lls"', "estimators = 'lls': must be a list, such as [\"lls\"]"),
    ("gr", 'estimators = ["lsl"]', "estimators = ['lsl']", "'lsl' unknown; did you mean 'lls'? Known are mle, "),
    ("gr", 'estimators = ["lls", "lls"]', "estimators", "'lls' given more than once; give each value once"),
    ("gr", "^ noise_shape = [[1, 0], [0, 1]]", "noise_shape = [[1, 0], [0, 1]]", DEFINITE),
    *(("gr", f"^ noise_shape = [[1, 0, 0], [0, 1, 0], [0, 0, {last}]]", DEFINITE) for last in (-1, 0)),
    *(("gr", f"^ noise_shape = {shape}", DEFINITE) for shape in SINGULAR),
    ("gr", HUGE_SHAPE, "noise_shape"),
    ("gr", "^ noise_shape = [[1, 0, 0], [0, 1, 0]]", "3 × 3 matrix"),
    ("gr", 'kind = "gird"', "design.kind = 'gird'", "must be one of 'random', 'grid'"),
    ("gr", "kind > ", "line 5: design.kind: required, but missing; must be one of 'random', 'grid'"),
    ("gr", "[design] > [desing]", "did you mean 'design'?"),
    ("gr", "trials = 0", "design.trials = 0", "greater than or equal to 1"),
    ("gr", "trials = 2.0", "design.trials = 2.0", "integer"),
    ("gr", "samples = 10.5", "design.samples = 10.5|10.5 not allowed", "whole number"),
    ("gr", "samples = 1_000_000_001", MEMORY + ": at most 1,000,000,000 are allowed"),
    *(("g", f"samples = {many}", MEMORY) for many in ("[10, 2e9]", "{ logspace = [10, 1e10, 3] }")),
    *(("r", f"samples = {{ law = {law} }}", MEMORY) for law in MANY_SAMPLES),
    ("gr", "noise > ", "line 5: design: give one of noise, noise_over_radius and kappa (found none)"),
    ("gr", "noise_over_radius = 1", "line 5: design: ", "(found noise and noise_over_radius)"),
    ("g", "kappa = 3", "line 5: design: give one of noise, noise_over_radius and kappa (found noise and kappa)"),
    ("g", "noise > kappa = [3, -1]", "line 9: design.kappa = [3, -1]: -1 not allowed: every value must be above 0"),
    ("g", 'noise > kappa = 3\ndirections = "polar"', "line 9: design.kappa: is of directions by area: take"),
    ("g", "noise > kappa = 1e-6\nmost_noise = 0.9", "line 12: design.most_noise = 0.9: leaves no cell: raise it, or"),
    ("gr", "noise = 0", "design.noise = 0|0 not allowed", "above 0"),
    ("gr", 'noise = "a"', "design.noise = 'a'", "above 0|law"),
    ("gr", "noise = true", "design.noise = True", "number|every value"),
    *(("gr", f"noise = {value}", f"design.noise = {value}", "finite|every value") for value in ("nan", "inf")),
    ("gr", "noise = 1979-05-27", "design.noise = datetime", "above 0|law"),
    ("gr", "angle = 0", "design.angle = 0|0 not allowed", "above 0 and at most 180 degrees"),
    ("gr", "angle = 180.1", "design.angle = 180.1|180.1 not allowed", "above 0 and at most 180 degrees"),
    ("gr", "radius = 0", "design.radius = 0|0 not allowed", "above 0"),
    ("gr", "radius = 1e-300", "design.radius = 1e-300|1e-300 not allowed", "between 1e-100 and 1e100"),
    ("gr", "radius = 1e160", "design.radius = 1e+160|1e+160 not allowed", "between 1e-100 and 1e100"),
    ("gr", "center = -1", "design.center = -1|-1 not allowed", "at least 0"),
    ("g", "samples = []", "design.samples = []", "the list is empty"),
    ("g", "samples = [10, 3.5]", "3.5 not allowed", "whole number"),
    ("g", "samples = [20, 10, 20, 1e1]", "design.samples", "20, 10 given more than once; give each value once"),
    ("g", "samples = { linspace = [4, 9] }", "linspace = [4, 9] not understood", "[first, last, count]"),
    ("g", "samples = { linspace = [4, 9, 0] }", "count = 0", "whole number"),
    ("g", "samples = { linspace = [4, 9, 2.5] }", "count = 2.5", "whole number"),
    ("g", "noise = { linspace = [-1.7e308, 1.7e308, 3] }", "design.noise = "),
    ("g", "noise = { linspace = [1, 2, 1] }", "cannot be 1 value"),
    ("g", "noise = { logspace = [0, 1, 3] }", "logspace from 0 to 1", "both ends above 0"),
    ("g", "noise = { linspace = [nan, 1, 3] }", "not understood", "[first, last, count]"),
    ("g", "noise = { linspce = [1, 2, 3] }", "keys linspce not understood", "logspace"),
    ("g", "noise = [0.1, -1, 'a', true]", "-1, 'a', True not allowed", "above 0"),
    ("g", "noise = [1, 0.1, 1.0]", "design.noise", "1 given more than once; give each value once"),
    ("g", 'noise = { law = "uniform", low = 1, high = 2 }', "design.noise", "linspace"),
    ("g", "angle = [90, 0, 181]", "0, 181 not allowed", "at most 180 degrees"),
    ("g", 'draws = "both"', "design.draws = 'both'", "'shared' or 'independent'"),
    ("g", "noise = { logspace = [1e-9, 1, 10_000] }\nangle = { linspace = [1, 180, 10_000] }", "line 5: " + MANY_CELLS),
    ("r", 'samples = { law = "choice", values = [4, 4.5, 9] }', "design.samples", "4.5", "whole number"),
    ("r", "noise = [0.1, 0.2]", "design.noise", 'law = "uniform"'),
    ("r", "noise = { low = 1, high = 2 }", "design.noise", 'law = "uniform"'),
    ("r", 'noise = { law = "normal", low = 1 }', "design.noise.law = 'normal'", "'uniform', 'log_uniform'"),
    ("r", 'noise = { law = "uniform", low = 2, high = 2 }', "design.noise", "low = 2 must be below high = 2"),
    ("r", 'noise = { law = "uniform", low = 1, hihg = 2 }', "design.noise.hihg = 2", "did you mean 'high'?"),
    ("r", 'noise = { law = "uniform", low = 1 }', "design.noise.high", "required, but missing"),
    ("r", 'noise = { law = "uniform", low = -1, high = 2 }', "-1 not allowed", "above 0"),
    ("r", 'noise = { law = "log_uniform", low = 0, high = 2 }', "design.noise.low = 0", "greater than 0"),
    ("r", 'noise = { law = "choice", values = [] }', "design.noise.values = []", "must have a value"),
    ("r", 'noise = { law = "choice", values = [1, "a"] }', "design.noise.values[1] = 'a'", "number"),
    ("r", 'noise = { law = "uniform", low = true, high = 2 }', "design.noise.low = True", "number"),
    ("r", 'noise = { law = "uniform", low = 0, high = inf }', "design.noise.high = inf", "finite"),
    ("r", 'angle = { law = "uniform", low = 0, high = 181 }', "181 not allowed", "at most 180 degrees"),
    ("r", 'draws = "shared"', "design.draws = 'shared'", "unknown key: not one of this kind of design"),
    ("gr", '^ route = "cumulants"', "route = 'cumulants'", "'points' or 'moments'"),
    ("gr", '^ keep = "nothing"', "keep = 'nothing'", "'errors' or 'summary'"),
    ("g", '^ route = "moments"\nestimators = ["gdke"]\n^ keep_points = 1', "keep_points", "forms no points"),
    ("g", '^ keep = "summary"\n^ keep_points = 1', "keep_points", "does not store"),
    ("r", '^ keep = "summary"', 'keep: a random design has one trial in a cell: keep = "errors"'),
    ("r", 'estimators = ["gdke"]\n^ route = "moments"', "route: a random design draws every trial for one level"),
    ("g", f"{MOMENTS}\n{SHAPED}", 'the route "moments" is for isotropic noise'),
    ("g", '^ route = "moments"\nestimators = ["gdke", "mle", "lls"]', "mle, lls need the points; the moments s"),
    (
        "g",
        'law = "cauchy"',
        "'cauchy' not allowed: every value must be normal; laplace; ",
        "student(freedom) with freedom above 2",
    ),
    ("g", 'law = "student(2)"', "design.law = 'student(2)'", "such as student(5)"),
    ("g", "law = 3", "design.law = 3: 3 not allowed"),
    ("r", 'law = ["normal"]', "design.law = ", "should be a valid string"),
    ("g", "outlier_share = 1", "design.outlier_share = 1: 1 not allowed: every value must be a share: at least 0"),
    ("g", "outlier_share = -0.1", "design.outlier_share = -0.1: -0.1 not allowed"),
    ("g", "outlier_share = 0.1\noutlier_size = 0", "design.outlier_size = 0: 0 not allowed: every value must be"),
    ("g", "outlier_size = 5", "design.outlier_size: has no effect without outlier_share"),
    ("g", 'outlier_law = "along_radius(5, 20)"', "design.outlier_law: has no effect without outlier_share"),
    (
        "g",
        'outlier_share = 0.1\noutlier_law = "along_radius(5, 20)"\noutlier_size = 5',
        "design.outlier_size: has no effect: the numbers of outlier_law = along_radius(5, 20) say how far",
    ),
    (
        "g",
        'outlier_share = 0.1\noutlier_law = "along_radius(5)"',
        "must be any_direction; any_direction(size), such as",
    ),
    (
        "g",
        'coordinates = "rounded(0)"',
        "'rounded(0)' not allowed: every value must be exact or rounded(spacing), such as",
    ),
    ("g", 'directions = "laplace"', "'laplace' not allowed: every value must be area, polar, spaced or path"),
    ("g", 'directions = "even"', "design.directions = 'even': 'even' not allowed: every value must be area, polar"),
    ("g", 'dimension = 4\ndirections = "spaced"', "design.directions: spaced and path are directions of circles"),
    ("g", MOMENTS + '\nlaw = "laplace"', 'line 1: route: the route "moments" takes no account of law: take it out'),
    ("g", MOMENTS + "\nstated_variance = 0.5", "line 1: route: ", "takes no account of stated_variance: take it out"),
    ("g", f'law = "radial"\n{SHAPED}', "is the covariance of normal noise: take law"),
    ("g", "outlier_share = 0.1\n[posterior]", "posterior: its likelihoods, of normal", "account of outlier_share: "),
    ("g", "stated_variance = 0.5\n[posterior]", "the true σ and directions by area", "of stated_variance: take it"),
    ("g", "noise > noise_over_radius = 1e-250\nradius = 1e-100", "line 9: design.noise_over_radius = 1e-250: with "),
    ("gr", "noise = 1e-300\nradius = 1e100", "line 9: design.noise = 1e-300: with radius = 1e+100 σ/r is 0 in float64"),
    ("gr", "noise = 1e300\nradius = 1e-100", "line 9: design.noise = 1e+300: with radius = 1e-100 σ/r is inf in flo"),
    ("g", "noise > noise_over_radius = [1, 1e250]\nradius = [1, 1e100]", "line 9: ", " σ is inf in float64: give ano"),
    ("r", "noise > noise_over_radius = 1e-250\nradius = 1e-100", "line 9: ", "with radius = 1e-100 σ is 0 in float64"),
    ("cl", "^ posterior = 3", "posterior = 3: must be one table, whose entries follow a line [posterior]"),
    *(("cl", f"[posterior]\n{key} = {v}", f"{key} = {v}", f"than or equal to {most}") for key, v, most in BEYOND),
    *(("cl", f"[posterior]\ntrials = {v}", "posterior.trials = ", "integer") for v in ("2.0", '"2"', "true")),
    ("g", "[posterior]\ntrials = 4001", "trials = 4001: more trials than a cell has: design.trials = 4,000"),
    *(("cl", f"[posterior]\nbox = {v}", f"posterior.box = {v}", "greater than 0") for v in ("0", "-1.0")),
    *(("cl", f"[posterior]\nbox = {v}", f"posterior.box = {v}", "finite") for v in ("inf", "nan")),
    ("c", "[posterior]\nwalkers = 11", "posterior.walkers = 11: at least 12 are needed in dimension 3"),
    ("g", "dimension = 5\n[posterior]\nwalkers = 15", "posterior.walkers = 15: at least 16 are needed in dimension 5"),
    ("cl", '[posterior]\nnoise = ["known", "both"]', "posterior.noise[1] = 'both'", "'known' or 'unknown'"),
    ("cl", "[posterior]\nnoise = 0.1", "posterior.noise[0] = 0.1", "'known' or 'unknown'"),
    *(("cl", f"[posterior]\n{key} = []", f"posterior.{key} = []", "must have a value") for key, _ in TWICE),
    *(("cl", f"[posterior]\n{key} = {two}", f"posterior.{key}", "given more than once") for key, two in TWICE),
    ("cl", '[posterior]\nlikelihood = "flat"', "posterior.likelihood[0] = 'flat'", "'geometric' or 'whole_sphere'"),
    ("cl", "[posterior]\nwlakers = 64", "posterior.wlakers = 64", "unknown key; did you mean 'walkers'?"),
    ("cl", "[posterior]\nzzz = 1", "posterior.zzz = 1", "unknown key; known are trials, where, noise, likelihood, box"),
    ("cl", WHERE + "180", "posterior.where = 180", "must be a table of conditions and values, such as { angle = "),
    ("cl", WHERE + "{ angel = 180 }", "posterior.where", "angel unknown: conditions are samples, noise, noise_over_ra"),
    *(("cl", f"{WHERE}{{ {entry} }}", "posterior.where", NUMBER) for entry in NO_NUMBERS),
    ("cl", WHERE + "{ samples = [] }", "posterior.where", "every list must have a value"),
    *(("c", f"{WHERE}{{ {key} = {v} }}", f"posterior.where: no cell has {key} = {no}") for key, v, no in NO_CELL),
    ("c", "noise > noise_over_radius = [0.1, 0.2]\n" + WHERE + "{ noise = 0.3 }", "where: no cell has noise = 0.3"),
    ("l", WHERE + "{ radius = 3 }", "posterior.where: no cell has radius = 3"),
    ("l", WHERE + "{ noise_over_radius = 0.2 }", "posterior.where: no cell has noise_over_radius = 0.2"),
    ("cl", '[posterior]\nlikelihood = "whole_sphere"', WHOLE),
    ("c", WHERE + '{ angle = 60 }\nlikelihood = "whole_sphere"', WHOLE),
    ("c", "samples = [4, 20]\n" + WHERE + "{ samples = [20, 4] }", "line 13: " + FEW),
    ("c", "samples = [4, 20]\n[posterior]", FEW),
    ("l", 'samples = { law = "uniform", low = 4, high = 9 }\n[posterior]\nnoise = ["known", "unknown"]', FEW),
    ("c", "dimension = 2\nsamples = [3, 20]\n[posterior]\nnoise = 'unknown'", "needs at least 4 samples, not 3;"),
    ("g", "dimension = 5\nsamples = [6, 20]\n[posterior]\nnoise = 'unknown'", "needs at least 7 samples, not 6;"),
    ("c", f"{SHAPED}\n[posterior]", "of isotropic noise: take noise_shape out"),
    *(("g", f"[precision]\ntarget = {v}", f"precision.target = {v}", "greater than 0") for v in ("0.0", "-1.0")),
    *(("g", f"[precision]\ntarget = {v}", f"precision.target = {v}", "finite") for v in ("inf", "nan")),
    ("g", '[precision]\ntarget = "1 %"', "precision.target = '1 %'", "number"),
    ("g", "[precision]\nrelative_target = 0.0", "precision.relative_target = 0.0", "greater than 0"),
    ("g", "[precision]\nrelative_target = 1.0", "precision.relative_target = 1.0", "less than 1"),
    ("g", TARGET + "relative_target = 0.1", "line 12: precision", "one of the two (found target and relative_target)"),
    ("g", "[precision]\nfirst = 300", "line 12: precision", "or relative_target, one of the two (found neither)"),
    ("g", TARGET + "first = 99", "precision.first = 99", "greater than or equal to 100"),
    ("g", TARGET + "first = 4001", "precision.first = 4001", "design.trials = 4000 is the cap"),
    ("g", TARGET + "seconds = 0", "precision.seconds = 0", "greater than 0"),
    ("g", TARGET + "seconds = inf", "precision.seconds = inf", "finite"),
    ("g", TARGET + 'measure = "ratio_medain_ok"', "measure = 'ratio_medain_ok'", "mean 'ratio_median_ok'"),
    ("g", TARGET + 'measure = "planned"', "precision.measure = 'planned'", "known are relative_median"),
    ("g", TARGET + 'estimators = ["mle", "mle"]', "precision.estimators", "'mle' given more than once"),
    ("g", TARGET + 'estimators = ["ugdke"]', "not among the study's; did you mean 'ugdk'? Known are mle, ugdk"),
    ("g", TARGET + "tagret = 1.0", "precision.tagret = 1.0", "unknown key; did you mean 'target'?"),
    ("r", "[precision]\ntarget = 0.1", 'line 12: precision: a random design has one trial in a cell: design.kind = "'),
    ("g", '^ keep = "summary"\n[precision]\ntarget = 0.1', 'line 13: precision: needs the errors, which keep = "summa'),
    *(("gr", f"{key} > ", f"line 1: {key}: required, but missing") for key in ("name", "seed", "estimators")),
    *(("gr", f"{key} > ", f"line 5: design.{key}: required, but missing") for key in ("trials", "samples", "angle")),
    *(("gr", f"{key} > {key}s = 1", f"{key}s = 1", f"did you mean '{key}'?") for key in ("seed", "trials", "noise")),
    *(("gr", f"{key} > {key}s = 1", f"mean '{key}'?") for key in ("name", "estimators", "samples", "angle")),
    *(("gr", f"{key} = {HUGE}", f"design.{key} = 1000") for key in ("samples", "noise", "angle", "radius", "center")),
]


@pytest.mark.parametrize(
    ("base", "edits", "words"),
    [(base, edits, words) for bases, edits, *words in CASES for base in bases],
    ids=lambda value: re.sub(r"\s+", " ", value)[:70] if isinstance(value, str) else "",
)
def test_each_fault_is_listed(base, edits, words):
    """A fault is told once, with its line, its place, its value and the values allowed; ``|`` stands between words."""
    text, number = changed(base, edits)
    lines = faults(text)
    assert len(lines) == 1 + (edits == HUGE_SHAPE), lines
    here = [line for line in lines if line.startswith(f"  line {number}: ") or words[0].startswith("line ")]
    for part in words:
        assert any(word in line for word in part.split("|") for line in here), lines


RIGHT = [
    ("grcl", "seed = 1"),
    ("gr", "samples = 1_000_000_000"),
    ("g", "[posterior]\ntrials = 4000"),
    ("c", "[posterior]\nbox = 3.0"),
    ("c", WHERE + "{ noise_over_radius = [0.05, 0.2], samples = 20 }"),  # .1/2, .2/1
    ("c", "noise > noise_over_radius = [0.1, 0.2]\n" + WHERE + "{ noise = [0.1, 0.4], samples = 20 }"),  # .1·1, .2·2
    ("c", WHERE + "{ noise = 0.10000000000001, center = 3, samples = 20.0 }"),
    ("l", WHERE + "{ radius = 2, noise_over_radius = [0.1, 0.3], noise = 7, angle = 30 }"),  # of intervals, any value
    ("cl", WHERE + '{ angle = 180 }\nlikelihood = ["geometric", "whole_sphere"]'),
    ("cl", 'angle = 180\n[posterior]\nlikelihood = "whole_sphere"'),
    ("c", "samples = [4, 20]\n" + WHERE + "{ samples = 20 }"),
    ("c", "samples = [4, 20]\n[posterior]\nnoise = 'known'"),
    ("c", "dimension = 2\nsamples = [4, 20]\n[posterior]\nwalkers = 10"),
    ("g", "dimension = 5\nsamples = [7, 20]\n[posterior]\nwalkers = 16"),
    ("c", SHAPED),
]


@pytest.mark.parametrize(("bases", "edits"), RIGHT, ids=lambda value: re.sub(r"\s+", " ", value))
def test_these_are_right(bases, edits):
    """The configs that the faults above are made of, and what is just allowed."""
    for base in bases:
        assert parse(changed(base, edits)[0]).name == "test"


@pytest.mark.parametrize("d", [2, 3, 5])
@pytest.mark.parametrize(
    ("base", "samples"),
    [
        *(("g", text) for text in ("{}", "[99, {}]", "{{ linspace = [{}, 50, 2] }}", "{{ logspace = [50, {}, 2] }}")),
        *(("r", f'{{{{ law = "{law}", low = {{}}, high = 99 }}}}') for law in ("uniform", "log_uniform")),
        *(("r", text) for text in ('{{ law = "choice", values = [9, {}] }}', '{{ law = "constant", value = {} }}')),
    ],
)
def test_too_few_samples_for_the_dimension(d, base, samples):
    """N = d is refused in every spelling, also as a law's lower end, and N = d + 1 is taken."""
    few, enough = (changed(base, f"dimension = {d}\nsamples = {samples.format(n)}")[0] for n in (d, d + 1))
    assert "design.samples = " in faults(few)[0]
    assert f": {d} samples are too few: a sphere in dimension {d} needs at least {d + 1}" in faults(few)[0]
    assert parse(enough).dimension == d


def test_each_value_that_no_cell_has():
    """Each has a line of its own; faults of a section stand with the others in the order of the file."""
    text, number = changed("c", WHERE + "{ angle = [45, 60, 90], noise = 0.3, samples = 20 }")
    words = ("angle = 45", "angle = 90", "noise = 0.3")
    assert faults(text) == [f"  line {number}: posterior.where: no cell has {value}" for value in words]
    edits = "samples = [4, 20]\n[posterior]\nnoise = 'unknown'\nlikelihood = 'whole_sphere'\n"
    text, number = changed("c", edits + "where = { samples = [4, 9], angle = 61 }")
    assert [int(line.split()[1].strip(":")) for line in faults(text)] == [number - 2, number - 1, number, number]


MANY = """name = "Test"
seed = -1
dimension = 5
estimators = ["lls", "ugkd"]
noise_shape = [[1, 0], [0, 1]]
keep = 3

[design]
kind = "grid"
trials = 0
samples = [5, 20]
noise = [0.1, -0.2]
noise_over_radius = 0.1
angle = [90, 200]
radius = "one"
"""


def test_all_faults_at_once_in_the_order_of_the_file():
    """Eleven faults give as many lines, sorted, none swallowed by another, nor by a key named like a design or law."""
    lines = faults(MANY)
    assert [int(line.split()[1].rstrip(":")) for line in lines] == [1, 2, 4, 5, 6, 8, 10, 11, 12, 14, 15]
    places = ["name", "seed", "estimators", "noise_shape", "keep", "design", "design.trials", "design.samples"]
    places += ["design.noise", "design.angle", "design.radius"]
    assert [line.split(": ")[1].split(" = ")[0] for line in lines] == places
    more = "\n".join(faults(MANY + 'grid = 1\n"new\\nline" = "new\\nline"\n'))
    assert "design.radius = 'one'" in more
    assert "design.grid = 1: unknown key" in more
    for key in ("uniform", "low"):
        noise = f'noise = {{ law = "uniform", {key} = "a", high = "b" }}'
        more = "\n".join(faults(MANY.replace('"grid"', '"random"').replace("noise = [0.1, -0.2]", noise)))
        assert f"design.noise.{key} = 'a'" in more
        assert "design.noise.high = 'b'" in more
    assert [line.split(": ")[1] for line in faults("")] == ["name", "seed", "estimators", "design"]


@pytest.mark.parametrize(
    "head",
    [
        "design = { kind = 'grid', trials = 0 }",
        "[design]\nkind = 'grid'\ntrials = 0",
        "design.kind = 'grid'\ndesign.trials = 0",
    ],
    ids=["inline", "headed", "dotted"],
)
def test_tables_inline_headed_or_dotted(head):
    """A design is read however TOML lets it be written, and its faults have the line of the key or the table."""
    (line,) = [line for line in faults(f"name = 'test'\n{head}\n") if "design.trials = 0" in line]
    assert line.startswith(f"  line {2 + head.count(chr(10))}: ")


@pytest.mark.parametrize(
    "text", ["name = ", "name = 'a'\nname = 'b'", "just words", "[design", "a = [1,", f"a = {5000 * '9'}"], ids=len
)
def test_what_is_not_toml(text):
    """The message about a file that is no TOML is that of the TOML reader."""
    with pytest.raises(ConfigError, match=r"^x\.toml: not TOML: .*(line|end of document|digits)"):
        parse(text, "x.toml")
    deep = (3000 * "[" + 3000 * "]", 3000 * "{ a = " + "1" + 3000 * "}", "1\n[b" + 3000 * ".a" + "]")
    for text in (*deep, f"1\nb{3000 * '.a'} = 1"):  # deeper than the reader, or what comes after it, can follow
        with pytest.raises(ConfigError, match=r"^x\.toml: tables or lists stand in each other more than 50 deep; .*$"):
            parse(f"a = {text}", "x.toml")
    for text, key in (("design = 3", "design"), ("[[design]]\ntrials = 3", "design"), ("[[precision]]", "precision")):
        with pytest.raises(ConfigError, match=rf"line 1: {key} = .*: must be one table, whose entries follow a line"):
            parse(text)


def test_thousands_of_faults():
    """Fifty are shown, in the order of the file, and the number of the others; a list of names is cut."""
    keys = "".join(f"key{i} = {i}\n" for i in range(2_000))
    with pytest.raises(ConfigError) as caught:
        parse(keys + GRID, "x.toml")
    head, *lines, last = str(caught.value).splitlines()
    assert (head, last) == ("x.toml: 2,000 faults", "  and 1,950 more")
    assert [line.split(" = ")[0] for line in lines] == [f"  line {i + 1}: key{i}" for i in range(50)]
    names = [f"name{i}" for i in range(3000)]
    for text in (
        GRID.replace('["mle", "ugdk"]', json.dumps(names)),
        GRID.replace('["mle", "ugdk"]', json.dumps(names * 2)),
        f"{GRID}[posterior]\nwhere = {{ {', '.join(f'{name} = 1' for name in names)} }}\n",
        f"{GRID}{''.join(names)} = 1\n",
    ):
        (line,) = faults(text)
        assert len(line) < 2000


@pytest.mark.parametrize(("size", "usable"), [(1e-101, False), (1e-100, True), (1e100, True), (1e101, False)])
def test_sizes_of_a_covariance(size, usable):
    """A noise shape whose squares are no numbers is refused; others are taken, and make no warning."""
    text = f"noise_shape = [[{size}, 0, 0], [0, {size}, 0], [0, 0, {size}]]\n{GRID}"
    if usable:
        assert parse(text).noise_shape[0][0] == size
    else:
        (line,) = faults(text)
        assert line.endswith("its largest number 1e-100 to 1e100")


def test_what_cannot_be_read(tmp_path):
    """A missing file, a folder and bytes that are no text have their reason; the mark of UTF-8 does no harm."""
    (tmp_path / "bytes.toml").write_bytes(b'name = "\xff"')
    for path, reason in [
        (tmp_path / "none.toml", "No such file or directory"),
        (tmp_path, "Is a directory"),
        (tmp_path / "bytes.toml", "not UTF-8 text; save it as UTF-8"),
    ]:
        with pytest.raises(ConfigError) as caught:
            load(path)
        assert str(caught.value) == f"{path}: cannot be read: {reason}"
    (tmp_path / "marked.toml").write_bytes(b"\xef\xbb\xbf" + GRID.encode())
    assert load(tmp_path / "marked.toml") == parse(GRID)


@pytest.mark.parametrize("measure", WITH_ERROR)
def test_a_fraction_of_a_share(measure):
    """A share may be 0, so its error cannot be a fraction of it; that of other measures can."""
    text = f'{GRID}[precision]\nmeasure = "{measure}"\n'
    if measure in ("far", "far_ok", "far_all"):
        (line,) = faults(text + "relative_target = 0.1\n")
        assert f"{measure} is a share, which may be 0, and no error is a fraction of 0: give target instead" in line
    else:
        assert parse(text + "relative_target = 0.1\n").precision.measure == measure
    assert parse(text + "target = 0.1\n").precision.target == 0.1


def test_precision_of_the_studys_own_measures():
    """A column of a measure of the study may decide, a share by its own target; a measure that it lacks may not."""
    head = GRID.replace("[design]", 'measures = ["interval"]\n[design]', 1)
    made = parse(f'{head}[precision]\nmeasure = "interval_width_median"\nrelative_target = 0.1\n').precision
    assert made.measure == "interval_width_median"
    text = '[precision]\nmeasure = "interval_radius"\n'
    (line,) = faults(f"{head}{text}relative_target = 0.1\n")
    assert "interval_radius is a share, which may be 0" in line
    (line,) = faults(f"{GRID}{text}target = 0.1\n")
    assert "precision.measure = 'interval_radius': no measure of the study's summary" in line


KEYS = ["name", "seed", "dimension", "estimators", "noise_shape", "keep_points", "precision", "design"]
KEYS += ["kind", "trials", "samples", "noise", "noise_over_radius", "angle", "radius", "center", "draws"]
KEYS += ["law", "value", "values", "low", "high", "linspace", "logspace", "grid", "random", "uniform", "constant"]
KEYS += ["target", "relative_target", "measure", "first", "seconds"]
WORDS = ["grid", "random", "uniform", "log_uniform", "choice", "constant", "shared", "lls", "mle", "test", "", "a.b"]

texts = st.sampled_from(WORDS) | st.text(st.characters(codec="utf-8", exclude_categories=["C"]), max_size=5)
numbers = (
    st.integers(-5, 2000)
    | st.sampled_from([0, 3, 4, 90, 180, 10**8, -(10**30), 10**308, 10**400])
    | st.floats()
    | st.sampled_from([0.0, -0.0, 0.1, 4.5, 180.0, 1e-320, 1e308, math.inf, math.nan])
)
values = st.recursive(
    numbers | texts | st.booleans(),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from(KEYS) | texts, inner, max_size=4)
        | st.fixed_dictionaries({"law": texts}, optional=dict.fromkeys(("low", "high", "value", "values"), inner))
        | st.fixed_dictionaries({}, optional={k: st.lists(numbers, max_size=4) for k in ("linspace", "logspace")})
    ),
    max_leaves=6,
)
any_document = settings(deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


def outcome(data):
    """Parse a dictionary written as TOML; what is no study is a message of several parts."""
    text = "\n".join(f"{json.dumps(key, ensure_ascii=False)} = {toml(value)}" for key, value in data.items())
    try:
        study = parse(text, "x.toml")
    except ConfigError as error:
        assert str(error).startswith("x.toml: ")  # noqa: PT017
        return None
    assert isinstance(study, Study)
    assert Study.model_validate_json(study.model_dump_json()).digest() == study.digest()
    return study


@settings(any_document, max_examples=200)
@given(
    kind=st.sampled_from(["grid", "random"]),
    head=st.dictionaries(st.sampled_from(KEYS[:7]) | texts, values, max_size=2),
    body=st.dictionaries(st.sampled_from(KEYS[8:17]) | texts, numbers | values, max_size=2),
)
def test_almost_right(kind, head, body):
    """A good config with up to four keys replaced by anything is a study or a fault."""
    design = {"kind": kind, "trials": 2, "samples": 10, "noise": 0.1, "angle": 90.0}
    good = {"name": "test", "seed": 1, "dimension": 3, "estimators": ["lls"]}
    assert outcome(good | {"design": design}) is not None
    outcome(good | head | {"design": design | body})
