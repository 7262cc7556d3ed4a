"""Walks with known strikes and offs: a body of straight limbs whose feet stand still on the floor, or on a belt.

A foot strikes with its heel and turns about it until it is flat. In the last third of stance it turns about the tip of
its toes, which leaves the floor as the foot points down by 60°. In between it swings; the heel comes down with a third
of the walking speed, which the floor stops. The markers of the metatarsal heads are behind the tip. The knee follows
from hip and ankle. Thighs and shanks have clusters of four markers.
"""

import numpy as np

from study.recordings.recording import Laboratory, Recording

SHARE = 0.62
"""Stance, as a share of the cycle."""


def hermite(u, a, b, da, db):
    """A cubic from a to b with slopes da and db at u = 0 and 1."""
    return (2 * u**3 - 3 * u**2 + 1) * a + (u**3 - 2 * u**2 + u) * da + (3 * u**2 - 2 * u**3) * b + (u**3 - u**2) * db


def foot(time, start, cycle, stride, length):
    """Heel and toe (2, 2, n), metres ahead and up, of a foot that strikes at start + k cycle, at 0 ahead for k = 0."""
    phase, count = np.modf((time - start) / cycle + 50.0)
    count -= 50.0
    ground = count * stride
    turn = lambda angle: np.array([np.cos(angle), np.sin(angle)]) * length  # noqa: E731
    strike, gone, late = np.radians(18.0), np.radians(-60.0), 0.42
    angle = np.zeros_like(phase)
    landing, rising, swing = phase < 0.1, (phase > late) & (phase <= SHARE), phase > SHARE
    angle[landing] = strike * (1 - phase[landing] / 0.1)
    u = (phase[rising] - late) / (SHARE - late)
    angle[rising] = gone * u**2
    u = (phase[swing] - SHARE) / (1 - SHARE)
    whole = (1 - SHARE) * cycle
    angle[swing] = hermite(u, gone, strike, 2 * gone * (1 - SHARE) / (SHARE - late) * 0.5, 0.0)
    heel = np.stack([ground, 0.0 * phase])
    flat_toe = np.stack([ground + length, 0.0 * phase])
    back = (phase > late) & ~swing
    heel[:, back] = flat_toe[:, back] - turn(angle[back])
    toe = heel + turn(angle)
    # in swing the toe starts at rest; the heel arrives with a third of the walking speed, downwards with a tenth
    speed = stride / cycle
    first, last = np.array([length, 0.0]), np.array([stride, 0.0]) + turn(strike)
    arriving = whole * speed * np.array([0.33, -0.1])
    for axis in range(2):
        toe[axis, swing] = hermite(u, first[axis], last[axis], 0.0, arriving[axis])
    toe[0, swing] += ground[swing]
    toe[1, swing] += 0.04 * length / 0.25 * np.sin(np.pi * u) ** 2
    heel[:, swing] = toe[:, swing] - turn(angle[swing])
    return np.stack([heel, toe])


def cluster(start, end, aside):
    """Four markers (4, 3, n) on a limb from start to end (3, n), beside it by ``aside`` metres."""
    along = end - start
    across = np.stack([along[2], 0 * along[0], -along[0]]) / np.linalg.norm(along, axis=0)
    lateral = np.array([[0.0], [aside], [0.0]])
    spots = [(0.3, 0.03), (0.3, -0.03), (0.6, 0.03), (0.6, -0.03)]
    return np.stack([start + share * along + lateral + off * across for share, off in spots])


def walk(seed, height=1.75, speed=1.3, rate=100.0, seconds=6.0, belt=False, noise=0.0005, yaw=0.0):
    """A walk of a body of a height, metres, at a speed, m/s, and the true times of strikes and offs.

    Returns:
        The recording, labels by side, segment and number; and the times by (side, kind), seconds.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    size = height / 1.75
    stride = 1.35 * size * (speed / (1.3 * np.sqrt(size))) ** 0.5  # longer in fast walks
    cycle = stride / speed
    length, leg = 0.25 * size, 0.86 * size
    middle = speed * time
    pelvis = np.stack(
        [middle, 0.01 * np.sin(2 * np.pi * time / cycle), leg + 0.08 * size + 0.015 * np.cos(4 * np.pi * time / cycle)]
    )
    markers, places, truth = [], [], {}
    spots = {
        "L_ASIS": (0.07, 0.12, 0.02),
        "R_ASIS": (0.07, -0.12, 0.02),
        "L_PSIS": (-0.1, 0.05, 0.02),
        "R_PSIS": (-0.1, -0.05, 0.02),
    }
    for label, spot in spots.items():
        markers.append(label)
        places.append(pelvis + size * np.array(spot)[:, None])
    for side, sign, lag in (("left", 1.0, 0.0), ("right", -1.0, 0.5)):
        start = 0.137 + lag * cycle
        flat = foot(time, start, cycle, stride, length)
        # the heel strikes a third of a stride in front of the pelvis
        flat[:, 0] += speed * start + 0.31 * stride - 0.04 * size
        wide = sign * 0.09 * size * np.ones_like(time)
        heel, toe = (np.stack([place[0], wide, place[1] + 0.04 * size]) for place in flat)
        hip = pelvis + size * np.array([0.0, sign * 0.085, -0.06])[:, None]
        pointing = (toe - heel) / length
        ankle = heel + 0.05 * size * pointing + np.stack([-pointing[2], 0 * time, pointing[0]]) * 0.05 * size
        thigh, shank = 0.46 * size, 0.46 * size
        line = ankle - hip
        far = np.minimum(np.linalg.norm(line[[0, 2]], axis=0), 0.999 * (thigh + shank))
        lean = np.arctan2(line[0], -line[2]) + np.arccos(far / (thigh + shank))
        knee = hip + thigh * np.stack([np.sin(lean), 0 * time, -np.cos(lean)])
        knee[1] = wide
        letter = side[0].upper()
        for part, ends in (("THIGH", (hip, knee)), ("SHANK", (knee, ankle))):
            for number, place in enumerate(cluster(*ends, sign * 0.06), start=1):
                markers.append(f"{letter}_{part}_{number}")
                places.append(place)
        lateral = np.array([0.0, sign * 0.05 * size, 0.0])[:, None]
        for name, place in (("KNEE", knee), ("ANKLE", ankle)):
            markers += [f"{letter}_LAT_{name}", f"{letter}_MED_{name}"]
            places += [place + lateral, place - lateral]
        markers += [f"{letter}_HEEL", f"{letter}_MT5", f"{letter}_MT1", f"{letter}_TOE"]
        places += [
            heel + at * (toe - heel) + off * lateral for at, off in ((0, 0), (0.65, 0.8), (0.72, -0.8), (0.73, 0))
        ]
        strikes = np.arange(-2, 40) * cycle + start
        truth[side, "strike"] = strikes[(strikes > 0) & (strikes < time[-1])]
        offs = strikes + SHARE * cycle
        truth[side, "off"] = offs[(offs > 0) & (offs < time[-1])]
    positions = np.stack(places) + rng.normal(0.0, noise, (len(places), 3, len(time)))
    if belt:
        positions[:, 0] -= speed * time
    cosine, sine = np.cos(yaw), np.sin(yaw)
    positions = np.einsum(
        "ij,mjt->mit", np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]), positions
    )
    return Recording("walk", tuple(markers), positions, rate, laboratory=Laboratory()), truth
