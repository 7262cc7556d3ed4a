"""What version 2 promises to keep, as docs/api.md says: nothing of it goes, and more may come.

`promised.json` was written at version 2.0 by ``python tests/test_promises.py``. An entry leaves it with a new major
version alone.
"""

import json
from pathlib import Path

import pytest
from typer.main import get_command

import study
from study import cli
from study.fits.points.samples import Estimates, Status
from study.options import EXIT_CODES
from study.simulation.experiment.conditions import CONDITIONS
from study.simulation.experiment.config import Posterior, Precision, Study, parse
from study.simulation.experiment.designs import GridDesign, RandomDesign
from study.simulation.runs import schemas
from tests.configs import config

PROMISED = Path(__file__).with_name("promised.json")


def options(command):
    """Names of the options of a command."""
    return sorted(name for each in command.params for name in each.opts if name.startswith("-") and name != "--help")


def present():
    """What there is now, by kind."""
    group = get_command(cli.app)
    tables = schemas.declared(3, parse(config()).conditions())
    models = {"study": Study, "grid": GridDesign, "random": RandomDesign}
    models |= {"precision": Precision, "posterior": Posterior}
    return {
        "commands": {name: options(command) for name, command in group.commands.items()},
        "config keys": {name: sorted(model.model_fields) for name, model in models.items()},
        "conditions": sorted(CONDITIONS),
        "columns": {name: sorted(column.name for column in columns) for name, columns in tables.items()},
        "names": sorted(study.__all__),
        "estimators": sorted(name for name in study.ESTIMATORS if not name.startswith("_")),
        "fields of a fit": sorted(name for name in dir(study.Fit) if not name.startswith("_")),
        "fields of estimates": sorted(Estimates._fields),
        "statuses": {each.name: int(each) for each in Status},
        "exit codes": {str(int(code)): words for code, words in EXIT_CODES.items()},
    }


def gone(promised, now):
    """What is promised and not there: paths of keys and list entries."""
    if isinstance(promised, dict):
        for key, value in promised.items():
            if key not in now:
                yield key
            else:
                yield from (f"{key}: {each}" for each in gone(value, now[key]))
    elif isinstance(promised, list):
        yield from (str(each) for each in promised if each not in now)


@pytest.fixture(scope="module")
def now():
    return present()


@pytest.mark.parametrize("kind", json.loads(PROMISED.read_text(encoding="utf-8")) if PROMISED.exists() else [])
def test_what_is_promised_is_there(now, kind):
    """Every promised command, option, key, column, name and code is there."""
    promised = json.loads(PROMISED.read_text(encoding="utf-8"))[kind]
    assert list(gone(promised, now[kind])) == []


def test_numbers_keep_their_meaning(now):
    """A status keeps its number, which tables store."""
    promised = json.loads(PROMISED.read_text(encoding="utf-8"))
    assert {name: now["statuses"][name] for name in promised["statuses"]} == promised["statuses"]


def test_losses_are_found():
    """A command, an option and a name that are gone are named."""
    promised = {"commands": {"fit": ["--noise", "--plot"], "joint": []}, "names": ["fit"]}
    assert list(gone(promised, {"commands": {"fit": ["--noise"]}, "names": []})) == [
        "commands: fit: --plot",
        "commands: joint",
        "names: fit",
    ]


if __name__ == "__main__":
    PROMISED.write_text(json.dumps(present(), indent=1, ensure_ascii=False, sort_keys=True) + "\n", encoding="utf-8")
