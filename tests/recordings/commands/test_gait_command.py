"""The command `study gait`, as a user calls it."""

from dataclasses import replace

import study
from study.recordings.formats.write import write_recording
from study.recordings.synthetic.make import Recipe, synthesize


def test_the_command(works, read, refused, tmp_path):
    """Two walks give one report with its files; --json has the tables; a body without legs is refused."""
    recording, _ = synthesize(Recipe(900, 100.0, gait=True, markers="rizzoli"))
    paths = [write_recording(replace(recording, name=name), tmp_path / f"{name}.csv") for name in ("one", "two")]
    said = works("gait", *paths, "--out", "report")
    assert "cycles" in said
    names = {path.name for path in (tmp_path / "report").iterdir()}
    tables = {f"gait_{name}.parquet" for name in ("cycles", "curves", "means")}
    assert names == {"gait.html", "fig_gait.png", "fig_gait.svg", *tables}
    document = read("gait", *paths, "--out", "report")
    assert set(document) == {"cycles", "means", "notes", "files"}
    assert {row["recording"] for row in document["cycles"]} == {"one", "two"}
    own = study.find_gait([study.read_recording(path) for path in paths])
    assert len(own.cycles) == len(document["cycles"])
    body, _ = synthesize(Recipe(300, 100.0))
    refused("gait", write_recording(body, tmp_path / "body.csv"), says="no pelvis with both spines")
