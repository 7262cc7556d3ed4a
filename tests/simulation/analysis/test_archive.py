"""Archives: every file is described and whole, a run of the unpacked config has the same digests, damage is refused."""

import hashlib
import json
import shutil
import zipfile

import pytest
from typer.testing import CliRunner

from study import cli
from study.files import RunError
from study.simulation.analysis.archive import ademp, archive, codemeta, metadata, readme
from study.simulation.experiment.config import parse
from study.simulation.runs.adaptive import TimeBudget
from study.simulation.runs.run_folder import Run
from study.simulation.runs.runner import run as compute
from tests.configs import config

TOP = {"name": "deposited", "seed": 7, "estimators": ["als", "gdke"]}
SHAPE = [[2, 0, 0], [0, 0.5, 0], [0, 0, 0.5]]
CONFIG = "# A small grid.\n" + config(TOP, trials=6, samples=[8, 20])


@pytest.fixture(scope="module")
def run(make_run):
    return make_run(CONFIG)


@pytest.fixture(scope="module")
def unpacked(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("deposit")
    with zipfile.ZipFile(archive([run], folder / "runs.zip")) as file:
        assert file.testzip() is None
        file.extractall(folder / "unpacked")
    return folder / "unpacked"


def graph(folder):
    found = json.loads((folder / "ro-crate-metadata.json").read_text(encoding="utf-8"))["@graph"]
    return {entity["@id"]: entity for entity in found}


def test_every_file_is_described(unpacked):
    """RO-Crate 1.1: the root lists every file, each is an entity with its size, and every reference leads to one."""
    entities = graph(unpacked)
    files = {str(path.relative_to(unpacked)) for path in unpacked.rglob("*") if path.is_file()}
    listed = {each["@id"] for each in entities["./"]["hasPart"]}
    assert listed == files - {"ro-crate-metadata.json"}
    for name in listed:
        assert entities[name]["@type"] == "File"
        assert int(entities[name]["contentSize"]) == (unpacked / name).stat().st_size
    about = entities["ro-crate-metadata.json"]
    assert about["about"] == {"@id": "./"}
    assert about["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    known = set(entities) | {"https://w3id.org/ro/crate/1.1"}
    references = [value for entity in entities.values() for value in entity.values()]
    for value in references:
        for each in value if isinstance(value, list) else [value]:
            if isinstance(each, dict):
                assert each["@id"] in known


def test_the_run_is_an_action(unpacked, run):
    """Process Run Crate: an action of the software has the config as its object and the tables as its results."""
    entities = graph(unpacked)
    (mention,) = entities["./"]["mentions"]
    action, name = entities[mention["@id"]], run.study.run_name()
    assert action["@type"] == "CreateAction"
    assert entities[action["instrument"]["@id"]]["@type"] == "SoftwareApplication"
    assert action["object"] == {"@id": f"configs/{name}.toml"}
    assert action["startTime"] <= action["endTime"]
    for result in action["result"]:
        data = (unpacked / result["@id"]).read_bytes()
        assert entities[result["@id"]]["sha256"] == hashlib.sha256(data).hexdigest()


def test_schemas_and_pages(unpacked, run):
    """Each table has its columns with meanings; the pages name what they describe."""
    schemas = json.loads((unpacked / "schemas" / f"{run.study.run_name()}.json").read_text(encoding="utf-8"))
    for name, columns in schemas.items():
        assert [column["name"] for column in columns] == list(run.table(name).columns)
        assert all(column["meaning"] for column in columns)
    page = (unpacked / "ADEMP.md").read_text(encoding="utf-8")
    for word in ("Aims.** A small grid.", "N: 8, 20", "Kukush", "Seed: 7", "Conditions: 2. Trials: 6, so", "to 47.6%"):
        assert word in page
    assert f"study run configs/{run.study.run_name()}.toml" in (unpacked / "README.md").read_text(encoding="utf-8")
    assert (unpacked / "CITATION.cff").read_text(encoding="utf-8").startswith("cff-version")
    assert json.loads((unpacked / "codemeta.json").read_text(encoding="utf-8"))["@type"] == "SoftwareSourceCode"


def test_a_run_of_the_unpacked_config_has_the_same_digests(unpacked, run, make_run):
    """The config in the archive computes the same tables, to the byte."""
    config = (unpacked / "configs" / f"{run.study.run_name()}.toml").read_text(encoding="utf-8")
    again = make_run(config)
    archived = json.loads((unpacked / "runs" / run.study.run_name() / "manifest.json").read_text(encoding="utf-8"))
    for name in ("errors", "summary"):
        assert again.manifest()["tables"][name] == archived["tables"][name]
    assert Run.open(unpacked / "runs" / run.study.run_name()).table("errors").equals(run.table("errors"))


ON_A_CAP = "u uniform on a cap, z"


@pytest.mark.parametrize(
    ("top", "design", "words"),
    [
        ({}, {"law": ["normal", "student(5)"]}, f"{ON_A_CAP} of covariance I, by the law of the noise. Every"),
        ({}, {"outlier_share": [0.0, 0.1]}, f"{ON_A_CAP} normal; some samples are outliers, displaced in a random dir"),
        ({"noise_shape": SHAPE}, {}, f"{ON_A_CAP} normal with the covariance [[2, 0, 0], [0, 0.5, 0], [0, 0, 0.5]]."),
        ({}, {"law": "radial"}, f"{ON_A_CAP} of covariance I, by the law of the noise (radial: along u alone)."),
        ({}, {"directions": "polar"}, "u by its law on a cap"),
    ],
    ids=["law", "outliers", "shape", "radial", "directions"],
)
def test_noise_and_directions_in_words(make_run, top, design, words):
    """The page has the laws that the study has."""
    assert words in ademp([make_run(config(TOP | top, trials=6, **design))])


def test_equal_runs_make_equal_archives(run, tmp_path):
    """No time of the writing is in the file."""
    one, other = (archive([run], tmp_path / f"{name}.zip").read_bytes() for name in "ab")
    assert one == other


def test_a_damaged_run_is_refused(run, tmp_path):
    """With the command that makes the table again; no file is written."""
    folder = shutil.copytree(run.folder, tmp_path / "damaged")
    path = folder / "errors.parquet"
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    with pytest.raises(RunError, match=r"errors\.parquet: damaged: .*`study run .*\.toml --out .*` makes it again"):
        archive([Run.open(folder)], tmp_path / "out.zip")
    assert not (tmp_path / "out.zip").exists()


def test_a_run_that_its_budget_stopped_is_refused(tmp_path):
    """The config would compute other tables; the command in the message finishes the run."""
    text = CONFIG.replace("trials = 6", "trials = 400") + "[precision]\nrelative_target = 0.08\nfirst = 100\n"
    stopped = compute(parse(text), text, tmp_path / "run", jobs=1, budget=TimeBudget(0.0))
    with pytest.raises(RunError, match=r"stopped by its budget of 0 s: 0 of 2 cells .*; `study run .*` resumes it"):
        archive([stopped], tmp_path / "out.zip")
    assert not (tmp_path / "out.zip").exists()


def test_the_command(run, tmp_path):
    """It prints the file, and how much is in it."""
    done = CliRunner().invoke(cli.app, ["archive", str(run.folder), "--out", str(tmp_path / "one.zip")])
    assert done.exit_code == 0, done.output
    assert done.output.startswith(f"{tmp_path / 'one.zip'}: 1 run, ")
    assert zipfile.is_zipfile(tmp_path / "one.zip")


def test_mistakes(run, tmp_path):
    """Another suffix, and a run given twice."""
    with pytest.raises(RunError, match=r"ends in \.zip"):
        archive([run], tmp_path / "out.tar")
    with pytest.raises(RunError, match="given twice"):
        archive([run, run], tmp_path / "out.zip")


@pytest.mark.parametrize("dirty", [False, True])
def test_software_heritage_identifiers(run, tmp_path, monkeypatch, dirty):
    """Readers and machines get the identifiers of commit and tree, unless the code had changes beyond them."""
    ids = {"revision": f"swh:1:rev:{'a' * 40}", "directory": f"swh:1:dir:{'b' * 40}"}
    manifest = run.manifest()
    changed = manifest | {"software": manifest["software"] | ids | {"dirty": dirty}}
    monkeypatch.setattr(type(run), "manifest", lambda self: changed)
    expected = [] if dirty else list(ids.values())
    assert codemeta([run]).get("identifier", []) == expected
    (software,) = [each for each in metadata([run], {})["@graph"] if each["@type"] == "SoftwareApplication"]
    assert software.get("identifier", []) == expected
    assert all((each in readme([run])) is not dirty for each in ids.values())
