"""The test of fit, and what follows from it, measured; `python benchmarks/misfit.py` stores results/misfit*.csv.

misfit-level.csv has the level on clean data in the cells of configs/coverage.toml, and statuses and coverage by the
estimator's own intervals and by those that a user gets. misfit.csv has the power for shapes and laws of noise,
misfit-errors.csv errors of form and noise with memory, and misfit-hinges.csv circles in space, belts and caps. The name
of a part (`power`) makes that part alone. A folder of scans (x, y, z in a row, metres) makes misfit-scans.csv.
"""

import math
import sys
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.stats import t as student
from studies import ROOT, clean, covered, store

import study
from study import Status
from study.fits.goodness import BLOCKS, SMALL, Goodness
from study.fits.intervals import intervals
from study.fits.random import lanes
from study.simulation.coverage import read_design

SEED, SETS, POWER_SETS = 17, 4000, 200
"""Seed, data sets of a clean cell and of another."""
SIZES, NOISES = (50, 200, 1000), (0.01, 0.05)


def on_cap(rng, n, degrees):
    """Directions (n, 3) uniform on a cap about the first axis."""
    height = 1.0 - rng.uniform(size=n) * 2.0 * math.sin(math.radians(degrees) / 2.0) ** 2
    angle = rng.uniform(0.0, 2.0 * math.pi, n)
    across = np.sqrt(np.maximum(1.0 - height**2, 0.0))
    return np.column_stack([height, across * np.cos(angle), across * np.sin(angle)])


def cube(rng, n):
    """Points on the surface of a cube of edge 2."""
    x = rng.uniform(-1.0, 1.0, (n, 3))
    x[np.arange(n), rng.integers(3, size=n)] = rng.choice([-1.0, 1.0], n)
    return x


def cylinder(rng, n, turn):
    """Points on a cylinder of radius 1 and height 2, of a share of a turn."""
    angle = rng.uniform(0.0, 2.0 * math.pi * turn, n)
    return np.column_stack([np.cos(angle), np.sin(angle), rng.uniform(-1.0, 1.0, n)])


def cone(rng, n):
    """Points on a cone of half-angle 45° and height 1."""
    height, angle = np.sqrt(rng.uniform(size=n)), rng.uniform(0.0, 2.0 * math.pi, n)
    return np.column_stack([height * np.cos(angle), height * np.sin(angle), height])


def paraboloid(rng, n):
    """Points on z = ρ² over the unit disc."""
    x = cone(rng, n)
    x[:, 2] **= 2
    return x


def helix(rng, n):
    """Points of two turns of a helix, in order."""
    angle = np.linspace(0.0, 4.0 * math.pi, n)
    return np.column_stack([np.cos(angle), np.sin(angle), angle / (2.0 * math.pi)])


def torus(rng, n):
    """Points on the outer part of a torus of radii 1 and .5."""
    a, b = rng.uniform(-1.0, 1.0, n), rng.uniform(-1.0, 1.0, n)
    away = 1.0 + 0.5 * np.cos(b)
    return np.column_stack([away * np.cos(a), away * np.sin(a), 0.5 * np.sin(b)])


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
    "paraboloid": paraboloid,
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
    return np.column_stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])


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


LAWS = {
    "none": about_cap(38.0, lambda u, z, rng: z),
    "path, memory 0": on_a_path(0.0),
    "path, memory .5": on_a_path(0.5),
    "path, memory .9": on_a_path(0.9),
    "larger at the rim, 38°": about_cap(38.0, rim),
    "larger at the rim, 115°": about_cap(115.0, rim),
    "none in depth, 38°": about_cap(38.0, lambda u, z, rng: z * [0.0, 1.0, 1.0]),
    "none in depth, 115°": about_cap(115.0, lambda u, z, rng: z * [0.0, 1.0, 1.0]),
    "3 : 1 : 1, 38°": about_cap(38.0, lambda u, z, rng: z * [3.0, 1.0, 1.0]),
    "3 : 1 : 1, 115°": about_cap(115.0, lambda u, z, rng: z * [3.0, 1.0, 1.0]),
    "30 % moved out, 38°": about_cap(38.0, shifted),
    "30 % moved out, 115°": about_cap(115.0, shifted),
    "t5, 60°": about_cap(60.0, lambda u, z, rng: z / np.sqrt(rng.chisquare(5, (len(u), 1)) / 3.0)),
}


def row(kind, name, n, s, answer, **more):
    """A row of the table: share rejected at the level 1 %, and named by each block."""
    first, sets = answer.first(), len(answer.p)
    rejected = float(np.mean(answer.p < 0.01))
    shares = {f"first {block}": float(np.mean(first == block)) for block in BLOCKS}
    known = {"kind": kind, "name": name, "samples": n, "sigma": s, "sets": sets}
    return {**known, **more, "rejected": rejected, "rejected_error": error_of(rejected, sets), **shares}


def error_of(share, sets):
    """Standard error of a share, that of one hit at least."""
    held = min(max(share, 1.0 / sets), 1.0 - 1.0 / sets)
    return math.sqrt(held * (1.0 - held) / sets)


def statuses(status):
    """Shares of the statuses that say what the test of fit sees."""
    names = (Status.OK, Status.MISFIT, Status.OUTLIERS, Status.HINGE)
    return {member.name.lower(): float(np.mean(status == member)) for member in names}


def level(sets):
    """A row for each clean cell of the coverage study, with coverage by the intervals of white noise and as allowed."""
    for cell in read_design(ROOT / "configs" / "coverage.toml").cells():
        state = lanes(SEED, "misfit", cell.samples, cell.angle, cell.kappa)
        count = sets if cell.samples < 10_000 or cell.sigma < SMALL else sets // 10  # which take minutes
        fits = [study.fit(x.swapaxes(1, 2)) for x in clean(state, count, cell.samples, cell.angle, cell.sigma)]
        answer = Goodness(*(np.concatenate(block) for block in zip(*(fit.goodness for fit in fits), strict=True)))
        white = [intervals(fit.samples) for fit in fits]
        bounded = np.concatenate([ends.identified for ends in white])
        ok, status = (np.concatenate([getattr(fit, name) for fit in fits]) for name in ("ok", "status"))
        ends = [np.concatenate(part) for part in ([w.radius for w in white], [fit.interval("radius") for fit in fits])]
        inside = [covered(radius, 1.0) for radius in ends]
        more = {"bounded": float(bounded.mean()), **statuses(status)}
        more |= {"covers_white": float(inside[0].mean()), "covers": float(inside[1].mean())}
        more["ok_covers"] = float(inside[1][ok].mean()) if ok.any() else math.nan
        more["wider"] = float(np.mean((ends[0] != ends[1]).any(axis=1)))
        yield row("clean", f"cap {cell.angle:g}°, kappa {cell.kappa:g}", cell.samples, cell.sigma, answer, **more)


def power(sets):
    """A row for each shape and law of noise, with the share that is ok and coverage of the radius."""
    for number, (kind, name, draw) in enumerate(
        [("shape", k, lambda rng, n, s, f=f: f(rng, n) + s * rng.normal(size=(n, 3))) for k, f in SHAPES.items()]
        + [("noise", k, f) for k, f in LAWS.items()]
    ):
        for n in SIZES:
            for s in NOISES:
                rng = np.random.default_rng([SEED, number, n, round(1000 * s)])
                x = np.stack([draw(rng, n, s) for _ in range(sets)])
                fit = study.fit(x, ordered="path" in name)
                white = intervals(fit.samples)
                kept = white.identified & (fit.goodness.p >= 0.01)
                more = {"ok": float(white.identified.mean()), "ok_not_rejected": float(kept.mean())}
                if kind == "noise":
                    more["covers"] = float(covered(white.radius, 1.0).mean())
                    more["covers_allowed"] = float(covered(fit.interval("radius"), 1.0).mean())
                yield row(kind, name, n, s, fit.goodness, **more)


def form_on(u, length):
    """Covariance (n, n) of a Gaussian process of unit size on directions, squared-exponential in their chords."""
    return np.exp(-0.5 * np.maximum(2.0 - 2.0 * u @ u.T, 0.0) / length**2) + 1e-9 * np.eye(len(u))


def best_test(rng, u, covariance, size, sets=1000):
    """The most powerful test of a form of known covariance on directions u (n, 3), for small noise, at a level of 1 %.

    By Neyman and Pearson, from what 1 and e leave of the residuals, whatever their scale. No test that does not know
    the form does better.

    Returns:
        The share of data sets in which it speaks, and the share of the others whose interval of white noise covers.
    """
    n = len(u)
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
    covers = float(np.mean((np.abs(pull @ noise) <= half)[unseen])) if unseen.any() else math.nan
    return float(np.mean(~unseen)), covers


def structured():
    """Laws of structured noise: name, whether rows are in order, numbers of points, and a function that makes them.

    It gives points (n, 3) and, of a form on directions, those directions, their covariance and the size.
    """
    for angle in (30.0, 60.0, 120.0):
        for length in (0.15, 0.4, 1.0):
            for size in (0.3, 1.0, 3.0):

                def formed(rng, n, angle=angle, length=length, size=size):
                    u = on_cap(rng, n, angle)
                    covariance = form_on(u, length * math.radians(angle))
                    r = 1.0 + 0.01 * size * np.linalg.cholesky(covariance) @ rng.normal(size=n)
                    return u * r[:, None] + 0.01 * rng.normal(size=(n, 3)), (u, covariance, size)

                yield f"form, {angle:g}°, length {length:g}, size {size:g}", False, (500,), formed
    for reach in (20.0, 45.0, 90.0):
        for memory in (0.5, 0.8, 0.95):

            def walked(rng, n, reach=reach, memory=memory):
                return path(n, reach) + 0.01 * ar1(rng, n, memory), None

            for ordered in (True, False):
                order = "in order" if ordered else "order not given"
                yield f"path of ± {reach:g}°, memory {memory:g}, {order}", ordered, (100, 300, 1000, 3000), walked


def errors(sets):
    """A row for each law of structured noise: coverage of radius and centre, of all fits and of those that are ok."""
    for number, (name, ordered, sizes, draw) in enumerate(structured()):
        for n in sizes:
            rng = np.random.default_rng([SEED, 100 + number, n])
            drawn = [draw(rng, n) for _ in range(sets)]
            fit = study.fit(np.stack([points for points, _ in drawn]), ordered=ordered)
            inside = covered(fit.interval("radius"), 1.0)
            center = covered(fit.interval("center"), 0.0).mean(axis=1)
            result = {"name": name, "samples": n, "sets": sets, **statuses(fit.status)}
            result |= {"covers_white": float(covered(intervals(fit.samples).radius, 1.0).mean())}
            result |= {"covers": float(inside.mean()), "covers_error": error_of(inside.mean(), sets)}
            result["covers_or_doubted"] = float((inside | ~fit.ok).mean())
            for part, holds in (("ok_covers", inside), ("ok_covers_center", center)):
                result[part] = float(holds[fit.ok].mean()) if fit.ok.any() else math.nan
            if drawn[0][1] is not None:
                best = np.mean([best_test(rng, *known) for _, known in drawn[:5]], axis=0)
                result |= dict(zip(("best_seen", "best_unseen_covers"), map(float, best), strict=True))
            yield result


def belt(rng, n, reach, width):
    """Directions (n, 3) of an arc of ± reach degrees on a great circle, or of a belt about it."""
    a, b = (np.radians(rng.uniform(-half, half, n)) for half in (reach, width))
    return np.column_stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)])


def hinges(sets):
    """A row for each arc, belt and cap: share that is named a hinge, and of bounded intervals among the others."""
    belts = [
        (f"± {reach:g}°, belt ± {width:g}°", lambda rng, n, r=reach, w=width: belt(rng, n, r, w))
        for reach in (30, 45, 90, 180)
        for width in (0, 1, 3)
    ]
    wide = [(f"belt ± {width:g}°", lambda rng, n, w=width: belt(rng, n, 180, w)) for width in (6, 12, 25)]
    caps = [(f"cap {angle:g}°", lambda rng, n, a=angle: on_cap(rng, n, a)) for angle in (20, 45, 90, 180)]
    for number, (name, draw) in enumerate(belts + wide + caps):
        for n in (30, 100, 300, 3000):
            for s in (0.003, 0.01, 0.03):
                rng = np.random.default_rng([SEED, 300 + number, n, round(1000 * s)])
                count = (5 if name.startswith("cap") and n < 300 else 1) * (sets if n < 3000 else sets // 4)
                fit = study.fit(np.stack([draw(rng, n) + s * rng.normal(size=(n, 3)) for _ in range(count)]))
                named, open_ended = fit.status == Status.HINGE, np.isinf(fit.interval("radius")[:, 1])
                found = {"name": name, "samples": n, "sigma": s, "sets": count, **statuses(fit.status)}
                found |= {"hinge_error": error_of(found["hinge"], count), "bounded": float((~open_ended).mean())}
                found["covers_radius"] = float(covered(fit.interval("radius"), 1.0).mean())
                found["covers_center"] = float(covered(fit.interval("center"), 0.0).mean())
                away = np.abs(fit.circle.radius - 1.0) <= 1.96 * fit.circle.radius_error
                found["circle_covers"] = float(away[named].mean()) if named.any() else math.nan
                yield found


def scans(folder):
    """A row for each scan of a folder: F, p values, errors and the interval of the radius, in millimetres."""
    for file in sorted(Path(folder).glob("*SPH*.xyz")):
        x = np.genfromtxt(file, delimiter="," if file.stem.startswith("t") else None)[:, :3] * 1000.0
        fit = study.fit(x, "corrected" if file.stem.startswith("t") else "robust")
        found = {"name": file.stem, "samples": int(fit.count), "radius": float(fit.radius)}
        low, high = fit.interval("radius")
        white = float(np.sqrt(fit.own_covariance[3, 3]))
        found |= {"error_white": white, "error": float(fit.standard_errors[3]), "low": float(low), "high": float(high)}
        found |= {f"p {block}": float(p) for block, p in zip(BLOCKS, fit.goodness, strict=True)}
        found |= {"misfit": str(fit.goodness.first()), "F": float(series_ratio(fit))}
        found |= {"status": Status(int(fit.status)).name.lower(), "holds_50": bool(low <= 50.0 <= high)}
        found["halves_cover"] = halves_cover(x) if file.stem.startswith("t") else math.nan
        yield found


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
    return float(np.mean(agree))


def series_ratio(fit):
    """F of the residuals on harmonics of degree 2, freed from 1 and e."""
    rho, e = fit.residuals, (fit.samples.points[0] - fit.center)
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    two = [e[:, i] * e[:, j] for i in range(3) for j in range(i, 3)][:5]
    kept = ~fit.outliers if fit.without_outliers else np.ones(len(rho), dtype=bool)
    Q = np.linalg.qr(np.column_stack([np.ones(len(e)), e, *two])[kept])[0]
    b = Q.T @ rho[kept]
    left = rho[kept] @ rho[kept] - b @ b
    return (b[4:] @ b[4:] / 5.0) / (left / (kept.sum() - 9))


PARTS = {
    "level": ("misfit-level", level, SETS),
    "power": ("misfit", power, POWER_SETS),
    "errors": ("misfit-errors", errors, POWER_SETS),
    "hinges": ("misfit-hinges", hinges, 100),
}

if __name__ == "__main__":
    if unknown := [part for part in sys.argv[1:] if part not in PARTS and not Path(part).is_dir()]:
        sys.exit(f"{', '.join(unknown)}: give any of {', '.join(PARTS)}, or a folder of scans")
    for part in sys.argv[1:] or PARTS:
        name, rows, sets = PARTS.get(part, ("misfit-scans", scans, part))
        store(name, rows(sets), "%.5g")
