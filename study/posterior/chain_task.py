"""The chains that a config asks for, each computed from its name alone.

A chain is named by its cell, trial, likelihood and whether the noise is known, and draws from a stream of that name. So
its numbers depend neither on the number of workers nor on an interruption, and more trials or cells leave the other
chains as they are.
"""

import hashlib
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from study.experiment.config import Study
from study.experiment.designs.cells import Cell
from study.experiment.posterior_config import Posterior
from study.experiment.replay import Address, addresses, replay
from study.experiment.streams import old_stream
from study.posterior import tables
from study.posterior.density import Prior
from study.posterior.sampler import sample

FORMAT = 2
"""Version of the sampler; a chain of another version is computed again."""


@dataclass(frozen=True)
class ChainTask:
    """One chain to run.

    Attributes:
        address: the trial.
        likelihood: name of the likelihood.
        noise_is: "known" or "unknown".
    """

    address: Address
    likelihood: str
    noise_is: str

    @property
    def key(self) -> dict[str, str | int]:
        """The columns that identify the chain in every table."""
        where = self.address
        names = {"likelihood": self.likelihood, "noise_is": self.noise_is}
        return {"cell": where.cell.name, "trial": where.trial, **names}

    def part(self, study: Study, posterior: Posterior) -> str:
        """Name of the chain's part: a digest of all that determines it."""
        settings = (posterior.box, posterior.walkers, posterior.max_steps, self._keeps_draws(posterior))
        content = repr((FORMAT, study.seed, study.dimension, study.estimators, settings, self.key, self.address.cell))
        return hashlib.sha256(content.encode()).hexdigest()[:20]

    def compute(self, study: Study, posterior: Posterior) -> dict[str, pa.Table]:
        """Run the chain; returns its rows of the posterior tables."""
        trial = replay(study, self.address)
        prior = prior_of(trial.cell, posterior, self.noise_is == "known")
        random = old_stream(study.seed, "posterior", *self.key.values())
        chain = sample(trial.samples, prior, self.likelihood, random, posterior.walkers, posterior.max_steps)
        return tables.rows(study, trial, chain, self.key, posterior.walkers, self._keeps_draws(posterior))

    def _keeps_draws(self, posterior: Posterior) -> bool:
        return self.address.trial < posterior.keep_draws


def prior_of(cell: Cell, posterior: Posterior, known: bool) -> Prior:
    """The prior of a cell's trials: a box about the true centre, and any radius that a centre in it can have."""
    center, width = np.array(cell.center), posterior.box * cell.radius
    return Prior(center, width, 2.0 * cell.radius + len(center) ** 0.5 * width, cell.noise, known)


def chain_tasks(study: Study, posterior: Posterior) -> list[ChainTask]:
    """Every chain that a config asks for, in the order of the tables."""
    places = [a for a in addresses(study, posterior.trials) if posterior.chooses(a.cell)]
    return [
        ChainTask(place, name, noise) for place in places for name in posterior.likelihood for noise in posterior.noise
    ]
