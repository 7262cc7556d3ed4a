"""The test of fit measured: its level on clean data, and its power; `python benchmarks/misfit.py` stores both.

Clean data are the cells of configs/coverage.toml. Shapes and laws of noise are those that fits do not show: fits of
them are ok, and intervals do not cover. A folder of scans given as argument (x, y, z in a row) is tested, and printed.
"""

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd

import study
from study.fits import Samples, cap
from study.fits.goodness import BLOCKS, Goodness, allowance, goodness
from study.fits.streams import lanes
from study.simulation.coverage import read_design

ROOT = Path(__file__).parents[1]
SEED, SETS, POWER_SETS = 17, 4000, 200
TOGETHER, MOST = 200_000, 600_000
"""Points that are drawn at a time, and points of a cell."""
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
    noise = rng.normal(size=(n, 3))
    for i in range(1, n):
        noise[i] = memory * noise[i - 1] + math.sqrt(1.0 - memory**2) * noise[i]
    return noise


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
    """A row of the table: share rejected at the level 1 %, and by each block at its share of the level."""
    first, sets = answer.first(0.01), len(answer.p)
    rejected = float(np.mean(answer.p < 0.01))
    error = math.sqrt(max(rejected, 1.0 / sets) * (1.0 - min(rejected, 1.0 - 1.0 / sets)) / sets)
    shares = {f"first {block}": float(np.mean(first == block)) for block in BLOCKS}
    known = {"kind": kind, "name": name, "samples": n, "sigma": s, "sets": sets}
    return {**known, **more, "rejected": rejected, "rejected_error": error, **shares}


def clean(sets):
    """A row for each cell of the grid of the coverage study."""
    for cell in read_design(ROOT / "configs" / "coverage.toml").cells():
        state, parts = lanes(SEED, "misfit", cell.samples, cell.angle, cell.kappa), []
        left = min(sets, MOST // cell.samples)
        while left > 0:
            size = min(left, max(TOGETHER // cell.samples, 1))
            left -= size
            directions, noise = np.empty((size, 3, cell.samples)), np.empty((size, 3, cell.samples))
            cap.draw(state, math.radians(cell.angle), directions, noise)
            directions[:, 0] = 1.0 - directions[:, 0]
            parts.append(goodness(Samples(directions + cell.sigma * noise)))
        answer = Goodness(*(np.concatenate(block) for block in zip(*parts, strict=True)))
        name = f"cap {cell.angle:g}°, kappa {cell.kappa:g}"
        yield row("clean", name, cell.samples, cell.sigma, answer)


def power(sets):
    """A row for each shape and law of noise, with the share that is ok today and coverage of the radius."""
    for number, (kind, name, draw) in enumerate(
        [("shape", k, lambda rng, n, s, f=f: f(rng, n) + s * rng.normal(size=(n, 3))) for k, f in SHAPES.items()]
        + [("noise", k, f) for k, f in LAWS.items()]
    ):
        for n in SIZES:
            for s in NOISES:
                rng = np.random.default_rng([SEED, number, n, round(1000 * s)])
                x = np.stack([draw(rng, n, s) for _ in range(sets)])
                fit = study.fit(x)
                answer = goodness(fit.samples)
                more = {"ok": float(fit.ok.mean()), "ok_not_rejected": float((fit.ok & ~(answer.p < 0.01)).mean())}
                if kind == "noise":
                    low, high = fit.interval("radius").T
                    wide = allowance(fit.samples, answer, ordered="path" in name)[:, 3]
                    half = 0.5 * (high - low) * wide
                    more["covers"] = float(((low <= 1.0) & (high >= 1.0)).mean())
                    more["covers_allowed"] = float((np.abs(0.5 * (low + high) - 1.0) <= half).mean())
                yield row(kind, name, n, s, answer, **more)


def scans(folder):
    """Print the scans of a folder: p values, the factor of the errors, radius and its interval without and with it."""
    for file in sorted(Path(folder).glob("t*.xyz")):
        x = np.genfromtxt(file, delimiter=",")[:, :3] * 1000.0
        fit = study.fit(x)
        answer = goodness(fit.samples)
        factor = float(allowance(fit.samples, answer, ordered=False)[0, 3])
        low, high = fit.interval("radius")
        half = 0.5 * (high - low) * factor
        p = ", ".join(f"{block} {float(value[0]):.2g}" for block, value in zip(BLOCKS, answer, strict=True))
        print(f"{file.stem}: n {len(x)}, r {fit.radius:.4f}, [{low:.4f}, {high:.4f}], ± {half:.4f}, {factor:.2f}; {p}")


def main():
    """Measure, and store each row as soon as it is known."""
    if len(sys.argv) > 1:
        scans(sys.argv[1])
        return
    rows = []
    for source in (power(POWER_SETS), clean(SETS)):
        for found in source:
            rows.append(found)
            pd.DataFrame(rows).to_csv(
                ROOT / "results" / "misfit.csv", index=False, lineterminator="\n", float_format="%.5g"
            )


if __name__ == "__main__":
    main()
