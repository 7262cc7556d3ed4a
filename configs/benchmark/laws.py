"""Laws of other people's simulations, as the configs of this folder name them.

study run configs/benchmark/b1.toml --plugin configs/benchmark/laws.py
"""

import numpy as np

import study


def contaminated(trial, count, least, most):
    """Normal noise along the radius; so many samples, chosen at random, are a uniform number of σ in or out instead."""
    away = np.einsum("nd,nd->n", trial.directions, trial.values)
    chosen = trial.rng.permutation(len(away))[: int(count)]
    away[chosen] = trial.rng.choice([-1.0, 1.0], len(chosen)) * trial.rng.uniform(least, most, len(chosen))
    return away[:, None] * trial.directions


def grid(trial, pixels):
    """Coordinates rounded to so many grid lines from the left of the circle to its centre, and as many from below."""
    return np.round((1.0 + trial.values) * pixels) / pixels - 1.0


def von_mises(trial, kappa):
    """Directions of a von Mises-Fisher law about the first axis."""
    n, d = trial.values.shape
    if d == 2:
        angle = trial.rng.vonmises(0.0, kappa, n)
        return np.column_stack([np.cos(angle), np.sin(angle)])
    along = 1.0 + np.log(1.0 - trial.rng.random(n) * (1.0 - np.exp(-2.0 * kappa))) / kappa
    turn, across = trial.rng.uniform(0.0, 2.0 * np.pi, n), np.sqrt(1.0 - along**2)
    return np.column_stack([along, across * np.cos(turn), across * np.sin(turn)])


study.register_law("contaminated", contaminated, "noise", example=[3, 5, 20], reference="arXiv 2507.11476, B1 and B2")
study.register_law("grid", grid, "coordinates", example=[30], reference="arXiv 2507.11476, B2")
study.register_law("von_mises", von_mises, "directions", example=[2], reference="Lesouple et al. 2021; Ulrich 1984")
