"""The test of fit, and what follows from it, measured; `python benchmarks/misfit.py` stores tables misfit*.csv.

misfit-level.csv has the level on clean data in the cells of configs/coverage.toml, and statuses and coverage by the
estimator's own intervals and by those that a user gets. misfit.csv has the power for shapes and laws of noise,
misfit-errors.csv errors of form and noise with memory, misfit-hinges.csv circles in space, belts and caps, and
misfit-untested.csv how many points a test needs. The name of a part (`power`) makes that part alone. A folder of scans
(x, y, z in a row, metres) makes misfit-scans.csv.
"""

import math
import sys
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.stats import norm
from scipy.stats import t as student
from studies import ROOT, caps, clean, covered, share, store

import study
from study import Status
from study.fits.answers.answer import white_covariance
from study.fits.errors.intervals import intervals
from study.fits.evidence.goodness import BLOCKS, SMALL, Goodness
from study.fits.loops.random import lanes
from study.simulation.experiment.config import load

SEED, SETS, POWER_SETS = 17, 4000, 200
"""Seed, data sets of a clean cell and of another."""
SIZES, NOISES = (50, 200, 1000), (0.01, 0.05)


def about_axis(across, angle, height):
    """Points (n, 3) by their distance from the third axis, angle about it, and height."""
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), height])


def on_cap(rng, n, degrees):
    """Directions (n, 3) uniform on a cap about the first axis."""
    height = 1.0 - rng.uniform(size=n) * 2.0 * math.sin(math.radians(degrees) / 2.0) ** 2
    angle = rng.uniform(0.0, 2.0 * math.pi, n)
    return np.roll(about_axis(np.sqrt(np.maximum(1.0 - height**2, 0.0)), angle, height), 1, axis=1)


def cube(rng, n):
    """Points on the surface of a cube of edge 2."""
    x = rng.uniform(-1.0, 1.0, (n, 3))
    x[np.arange(n), rng.integers(3, size=n)] = rng.choice([-1.0, 1.0], n)
    return x


def cylinder(rng, n, turn):
    """Points on a cylinder of radius 1 and height 2, of a share of a turn."""
    return about_axis(1.0, rng.uniform(0.0, 2.0 * math.pi * turn, n), rng.uniform(-1.0, 1.0, n))


def cone(rng, n):
    """Points on a cone of half-angle 45° and height 1."""
    height = np.sqrt(rng.uniform(size=n))
    return about_axis(height, rng.uniform(0.0, 2.0 * math.pi, n), height)


def helix(rng, n):
    """Points of two turns of a helix, in order."""
    angle = np.linspace(0.0, 4.0 * math.pi, n)
    return about_axis(1.0, angle, angle / (2.0 * math.pi))


def torus(rng, n):
    """Points on the outer part of a torus of radii 1 and .5."""
    a, b = rng.uniform(-1.0, 1.0, n), rng.uniform(-1.0, 1.0, n)
    return about_axis(1.0 + 0.5 * np.cos(b), a, 0.5 * np.sin(b))


SHAPES = {
    "sphere": lambda rng, n: on_cap(rng, n, 180.0),
    "ellipsoid 1 : .98 : .96": lambda rng, n: on_cap(rng, n, 180.0) * [1.0, 0.98, 0.96],
    "ellipsoid 1 : .9 : .8": lambda rng, n: on_cap(rng, n, 180.0) * [1.0, 0.9, 0.8],
    "its 72° cap": lambda rng, n: on_cap(rng, n, 72.0) * [1.0, 0.9, 0.8],
    "cube's surface": cube,
    "cube filled": lambda rng, n: rng.uniform(-1.0, 1.0, (n, 3)),
    "ball filled": lambda rng, n: on_cap(rng, n, 180.0) * np.cbrt(rng.uniform(size=(n, 1))),
    "cylinder": lambda rng, n: cylinder(rng, n, 1.0),
    "half a cylinder": lambda rng, n: cylinder(rng, n, 0.5),
    "60° of a cylinder": lambda rng, n: cylinder(rng, n, 1.0 / 6.0),
    "cone": cone,
    "paraboloid": lambda rng, n: cone(rng, n) ** [1.0, 1.0, 2.0],
    "torus patch": torus,
    "helix": helix,
    "spheres of 1 and .9": lambda rng, n: on_cap(rng, n, 180.0) * rng.choice([1.0, 0.9], (n, 1)),
    "random walk": lambda rng, n: np.cumsum(rng.normal(size=(n, 3)), axis=0) / math.sqrt(n),
}


def ar1(rng, n, memory):
    """Noise (n, 3) of unit size with memory."""
    first, white = rng.normal(size=(1, 3)), math.sqrt(1.0 - memory**2) * rng.normal(size=(n - 1, 3))
    return lfilter([1.0], [1.0, -memory], np.concatenate([first, white]), axis=0)


def path(n, reach):
    """Directions of a smooth path within ± reach degrees."""
    t, reach = np.linspace(0.0, 6.0 * math.pi, n), math.radians(reach)
    a, b = reach * np.sin(t), reach * np.sin(1.31 * t + 0.4)
    return about_axis(np.cos(b), a, np.sin(b))


def on_a_path(memory):
    """Points on a path with noise that remembers."""
    return lambda rng, n, s: path(n, 35.0) + s * ar1(rng, n, memory)


def about_cap(degrees, law):
    """Points on a cap with a law of noise, which gets the directions and unit normals."""

    def draw(rng, n, s):
        u = on_cap(rng, n, degrees)
        return u + s * law(u, rng.normal(size=(n, 3)), rng)

    return draw


def rim(u, z, rng):
    """Noise that grows to the rim, up to four times."""
    return z * (1.0 + 3.0 * (1.0 - u[:, :1]) / (1.0 - u[:, 0].min()))


def shifted(u, z, rng):
    """Three tenths of the points moved out by 6 σ."""
    return z + 6.0 * u * (rng.uniform(size=(len(u), 1)) < 0.3)


LAWS_ON_CAPS = {
    "larger at the rim": rim,
    "none in depth": lambda u, z, rng: z * [0.0, 1.0, 1.0],
    "3 : 1 : 1": lambda u, z, rng: z * [3.0, 1.0, 1.0],
    "30 % moved out": shifted,
}
LAWS = {
    "none": about_cap(38.0, lambda u, z, rng: z),
    "path, memory 0": on_a_path(0.0),
    "path, memory .5": on_a_path(0.5),
    "path, memory .9": on_a_path(0.9),
    **{f"{name}, {a:g}°": about_cap(a, law) for (name, law), a in product(LAWS_ON_CAPS.items(), (38.0, 115.0))},
    "t5, 60°": about_cap(60.0, lambda u, z, rng: z / np.sqrt(rng.chisquare(5, (len(u), 1)) / 3.0)),
}


def among(hits, chosen):
    """Share of hits among the chosen sets; NaN if there are none."""
    return np.mean(hits[chosen]) if chosen.any() else math.nan


def rejections(answer):
    """Share rejected at the level of 1 %, and named by each block."""
    return share("rejected", answer.p < 0.01) | {f"first {name}": np.mean(answer.first() == name) for name in BLOCKS}


def statuses(status):
    """Shares of the statuses that say what the test of fit sees."""
    return {name: np.mean(status == Status[name.upper()]) for name in ("ok", "misfit", "outliers", "hinge")}


def level(sets):
    """A row for each clean cell of the coverage study, with coverage by the intervals of white noise and as allowed."""
    groups = load(ROOT / "configs" / "coverage.toml").groups()
    for cell in (cell for group in groups for cell in group.cells):
        kappa = cell.values["kappa"]
        state = lanes(SEED, "misfit", cell.samples, cell.angle, kappa)
        count = sets if cell.samples < 10_000 or cell.noise < SMALL else sets // 10  # which take minutes
        fits = [study.fit(x.swapaxes(1, 2)) for x in clean(state, count, cell.samples, cell.angle, cell.noise)]
        answer = Goodness(
            *(np.concatenate(block, axis=-1) for block in zip(*(fit.goodness for fit in fits), strict=True))
        )
        looks = [intervals(fit.samples) for fit in fits]
        bounded, white = (np.concatenate([getattr(look, name) for look in looks]) for name in ("identified", "radius"))
        ok, status = (np.concatenate([getattr(fit, name) for fit in fits]) for name in ("ok", "status"))
        allowed = np.concatenate([fit.interval("radius") for fit in fits])
        row = {"kind": "clean", "name": f"cap {cell.angle:g}°, kappa {kappa:g}", "samples": cell.samples}
        row |= {"sigma": cell.noise, "sets": len(ok), "bounded": bounded.mean(), **statuses(status)}
        row |= {"covers_white": covered(white, 1.0).mean(), "covers": covered(allowed, 1.0).mean()}
        row |= {"ok_covers": among(covered(allowed, 1.0), ok), "wider": np.mean((white != allowed).any(axis=1))}
        yield row | rejections(answer)


def power(sets):
    """A row for each shape and law of noise, with the share that is ok and coverage of the radius.

    For shapes there is the power of the most powerful test that knows the noise and each point's place, on the shape or
    on the nearest sphere (Neyman and Pearson). It bounds every test at that level, closely if the shape is a surface.
    """
    laws = [("shape", k, lambda rng, n, s, f=f: f(rng, n) + s * rng.normal(size=(n, 3))) for k, f in SHAPES.items()]
    laws += [("noise", k, f) for k, f in LAWS.items()]
    for (number, (kind, name, draw)), n, s in product(enumerate(laws), SIZES, NOISES):
        rng = np.random.default_rng([SEED, number, n, round(1000 * s)])
        fit = study.fit(np.stack([draw(rng, n, s) for _ in range(sets)]), ordered="path" in name)
        white = intervals(fit.samples)
        row = {"kind": kind, "name": name, "samples": n, "sigma": s, "sets": sets, "ok": white.identified.mean()}
        row["ok_not_rejected"] = np.mean(white.identified & (fit.goodness.p >= 0.01))
        if kind == "noise":
            row["covers"] = covered(white.radius, 1.0).mean()
            row["covers_allowed"] = covered(fit.interval("radius"), 1.0).mean()
        else:
            away = study.fit(np.stack([draw(rng, n, 0.0) for _ in range(sets)]), "mle").residuals
            row["best"] = norm.cdf(np.linalg.norm(away, axis=1) / s - norm.ppf(0.99)).mean()
        yield row | rejections(fit.goodness)


def form_on(u, length):
    """Covariance (n, n) of a Gaussian process of unit size on directions, squared-exponential in their chords."""
    return np.exp(-0.5 * np.maximum(2.0 - 2.0 * u @ u.T, 0.0) / length**2) + 1e-9 * np.eye(len(u))


def best_test(rng, u, length, size, sets=1000):
    """The most powerful test of a form of known law on directions u (n, 3), for small noise, at a level of 1 %.

    By Neyman and Pearson, from what 1 and e leave of the residuals, whatever their scale. No test that does not know
    the form does better.

    Returns:
        The share of data sets in which it speaks, and the share of the others whose interval of white noise covers.
    """
    n, covariance = len(u), form_on(u, length)
    X = np.column_stack([np.ones(n), u])
    left = np.linalg.qr(X, mode="complete")[0][:, 4:]
    values, vectors = np.linalg.eigh(left.T @ covariance @ left)
    shrink = 1.0 / (1.0 + size**2 * np.maximum(values, 0.0))[:, None]

    def statistic(q):
        return (q**2).sum(axis=0) / (shrink * q**2).sum(axis=0)

    limit = np.quantile(statistic(rng.normal(size=(n - 4, 20 * sets))), 0.99)
    noise = rng.normal(size=(n, sets)) + size * np.linalg.cholesky(covariance) @ rng.normal(size=(n, sets))
    q, pull = vectors.T @ (left.T @ noise), np.linalg.pinv(X)[0]
    half = student.ppf(0.975, n - 4) * np.linalg.norm(pull) * np.sqrt((q**2).mean(axis=0))
    unseen = statistic(q) <= limit
    return np.mean(~unseen), among(np.abs(pull @ noise) <= half, unseen)


def formed(rng, n, angle, length, size):
    """Points (n, 3) with a form on a cap; the directions, the form's length and its size."""
    u, length = on_cap(rng, n, angle), length * math.radians(angle)
    r = 1.0 + 0.01 * size * np.linalg.cholesky(form_on(u, length)) @ rng.normal(size=n)
    return u * r[:, None] + 0.01 * rng.normal(size=(n, 3)), (u, length, size)


def walked(rng, n, reach, memory):
    """Points (n, 3) on a path, with noise that remembers."""
    return path(n, reach) + 0.01 * ar1(rng, n, memory), None


def structured():
    """Laws of structured noise: name, whether rows are in order, numbers of points, and a function that makes them."""
    for angle, length, size in product((30.0, 60.0, 120.0), (0.15, 0.4, 1.0), (0.3, 1.0, 3.0)):
        law = partial(formed, angle=angle, length=length, size=size)
        yield f"form, {angle:g}°, length {length:g}, size {size:g}", False, (500,), law
    for reach, memory, ordered in product((20.0, 45.0, 90.0), (0.5, 0.8, 0.95), (True, False)):
        name = f"path of ± {reach:g}°, memory {memory:g}, {'in order' if ordered else 'order not given'}"
        yield name, ordered, (100, 300, 1000, 3000), partial(walked, reach=reach, memory=memory)


def errors(sets):
    """A row for each law of structured noise: coverage of radius and centre, of all fits and of those that are ok.

    Forms have ten times as many data sets.
    """
    for number, (name, ordered, sizes, draw) in enumerate(structured()):
        for n in sizes:
            rng = np.random.default_rng([SEED, 100 + number, n])
            drawn = [draw(rng, n) for _ in range(10 * sets if name.startswith("form") else sets)]
            fit = study.fit(np.stack([points for points, _ in drawn]), ordered=ordered)
            inside = covered(fit.interval("radius"), 1.0)
            row = {"name": name, "samples": n, "sets": len(drawn), **statuses(fit.status)}
            row |= {"covers_white": covered(intervals(fit.samples).radius, 1.0).mean(), **share("covers", inside)}
            row |= {"covers_or_doubted": np.mean(inside | ~fit.ok), "ok_covers": among(inside, fit.ok)}
            row["ok_covers_center"] = among(covered(fit.interval("center"), 0.0).mean(axis=1), fit.ok)
            if drawn[0][1] is not None:
                best = np.mean([best_test(rng, *known) for _, known in drawn[:20]], axis=0)
                row["best_seen"], row["best_unseen_covers"] = best
            yield row


def belt(rng, n, reach, width):
    """Directions (n, 3) of an arc of ± reach degrees on a great circle, or of a belt about it."""
    a, b = (np.radians(rng.uniform(-half, half, n)) for half in (reach, width))
    return about_axis(np.cos(b), a, np.sin(b))


def hinges(sets):
    """A row for each arc, belt and cap: share that is named a hinge, and of bounded intervals among the others."""
    laws = [
        (f"± {reach:g}°, belt ± {width:g}°", partial(belt, reach=reach, width=width))
        for reach, width in product((30, 45, 90, 180), (0, 1, 3))
    ]
    laws += [(f"belt ± {width:g}°", partial(belt, reach=180, width=width)) for width in (6, 12, 25)]
    laws += [(f"cap {angle:g}°", partial(on_cap, degrees=angle)) for angle in (20, 45, 90, 180)]
    for (number, (name, draw)), n, s in product(enumerate(laws), (30, 100, 300, 3000), (0.003, 0.01, 0.03)):
        rng = np.random.default_rng([SEED, 300 + number, n, round(1000 * s)])
        count = (5 if name.startswith("cap") and n < 300 else 1) * (sets if n < 3000 else sets // 4)
        fit = study.fit(np.stack([draw(rng, n) + s * rng.normal(size=(n, 3)) for _ in range(count)]))
        named, circle = fit.status == Status.HINGE, fit.circle
        row = {"name": name, "samples": n, "sigma": s, "sets": count, **statuses(fit.status), **share("hinge", named)}
        row["bounded"] = np.isfinite(fit.interval("radius")[:, 1]).mean()
        row |= {f"covers_{name}": covered(fit.interval(name), t).mean() for name, t in (("radius", 1), ("center", 0))}
        row["circle_covers"] = among(np.abs(circle.radius - 1.0) <= 1.96 * circle.radius_error, named)
        yield row


def untested(sets):
    """A row for each dimension and small number of points all around a sphere, with the noise known and not."""
    for d, n, known in product((2, 3, 4), (6, 8, 10, 12, 15, 19, 25, 40), (False, True)):
        x = caps(np.random.default_rng([SEED, 500, d, n]), sets, n, 180.0, 0.02, d)
        fit = study.fit(x, noise=0.02 if known else None)
        row = {"dimension": d, "samples": n, "noise": "known" if known else "not known", "sets": sets}
        yield row | share("untested", fit.status == Status.UNTESTED) | share("ok", fit.ok)


def scans(folder):
    """A row for each scan of a folder: F, p values, errors and the interval of the radius, in millimetres."""
    for file in sorted(Path(folder).glob("*SPH*.xyz")):
        x = np.genfromtxt(file, delimiter="," if file.stem.startswith("t") else None)[:, :3] * 1000.0
        fit = study.fit(x, "corrected" if file.stem.startswith("t") else "robust")
        low, high = fit.interval("radius")
        row = {"name": file.stem, "samples": fit.count, "radius": fit.radius}
        row |= {"error_white": np.sqrt(white_covariance(fit)[3, 3]), "error": fit.standard_errors[3]}
        row |= {"low": low, "high": high, **{f"p {k}": p for k, p in zip(BLOCKS, fit.goodness.values, strict=True)}}
        row |= {"misfit": fit.goodness.first(), "F": series_ratio(fit)}
        row |= {"status": Status(int(fit.status)).name.lower(), "holds_50": low <= 50.0 <= high}
        row["halves_cover"] = halves_cover(x) if file.stem.startswith("t") else math.nan
        yield row


def halves_cover(x):
    """Share of coordinates in which the centres of two halves of a scan, of radius 50, agree within their intervals.

    The halves are those on both sides of the middle along each axis, of the rows, and of the distance from the pole.
    """
    away = x - np.median(x, axis=0)
    along = away @ np.linalg.eigh(np.cov(away.T))[1]
    agree = []
    for by in (*along.T, np.arange(len(x)), np.linalg.norm(along[:, 1:], axis=1)):
        fits = [study.fit(x[side], radius=50.0) for side in (by > np.median(by), by <= np.median(by))]
        half = np.hypot(*(0.5 * np.ptp(fit.interval("center"), axis=-1) for fit in fits))
        agree.append(np.abs(fits[0].center - fits[1].center) <= half)
    return np.mean(agree)


def series_ratio(fit):
    """F of the residuals on harmonics of degree 2, freed from 1 and e."""
    rho, e = fit.residuals, (fit.samples.points[0] - fit.center)
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    two = [e[:, i] * e[:, j] for i in range(3) for j in range(i, 3)][:5]
    kept = ~fit.outliers if fit.estimator == "robust" else np.ones(len(rho), dtype=bool)
    Q = np.linalg.qr(np.column_stack([np.ones(len(e)), e, *two])[kept])[0]
    b = Q.T @ rho[kept]
    left = rho[kept] @ rho[kept] - b @ b
    return (b[4:] @ b[4:] / 5.0) / (left / (kept.sum() - 9))


PARTS = {
    "level": ("misfit-level", level, SETS),
    "power": ("misfit", power, POWER_SETS),
    "errors": ("misfit-errors", errors, POWER_SETS),
    "hinges": ("misfit-hinges", hinges, 100),
    "untested": ("misfit-untested", untested, 1000),
}

if __name__ == "__main__":
    if unknown := [part for part in sys.argv[1:] if part not in PARTS and not Path(part).is_dir()]:
        sys.exit(f"{', '.join(unknown)}: give any of {', '.join(PARTS)}, or a folder of scans")
    for part in sys.argv[1:] or PARTS:
        name, rows, sets = PARTS.get(part, ("misfit-scans", scans, part))
        store(name, rows(sets), "%.5g")
