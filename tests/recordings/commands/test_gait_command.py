"""The command `study gait`, as a user calls it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import study
from study.recordings.formats.write import write_recording
from study.recordings.synthetic.make import Recipe, synthesize
from tests.recordings.walks import walk


def test_the_command(works, read, refused, tmp_path):
    """Two walks give one report with its files; --json has the tables; a body without legs is refused."""
    recording, _ = synthesize(Recipe(450, 100.0, gait=True, markers="rizzoli"))
    paths = [write_recording(replace(recording, name=name), tmp_path / f"{name}.csv") for name in ("one", "two")]
    said = works("gait", *paths, "--out", "report")
    assert "cycles" in said
    assert "one, two: up is z of the recording, in which " in said
    names = {path.name for path in (tmp_path / "report").iterdir()}
    tables = {f"gait_{name}.parquet" for name in ("cycles", "curves", "means")}
    assert names == {"gait.html", "fig_gait.png", "fig_gait.svg", *tables}
    assert set(pd.read_parquet(tmp_path / "report" / "gait_cycles.parquet")["recording"]) == {"one", "two"}
    document = read("gait", paths[0], "--out", "single")
    assert set(document) == {"cycles", "means", "events", "notes", "files"}
    assert {row["recording"] for row in document["cycles"]} == {"one"}
    own = study.find_gait([study.read_recording(paths[0])])
    assert len(own.cycles) == len(document["cycles"])
    body, _ = synthesize(Recipe(300, 100.0))
    refused("gait", write_recording(body, tmp_path / "body.csv"), says="no pelvis with both spines")


@pytest.mark.slow
def test_events_are_written_back(works, refused, tmp_path):
    """--write c3d stores the events; a second report takes them from the file, and writing again adds none."""
    recording, truth = walk(4, seconds=4.0)
    source = write_recording(recording, tmp_path / "walk.c3d")
    works("gait", source, "--write", "c3d", "--out", "one")
    written = tmp_path / "one" / "walk.c3d"
    events = study.read_recording(written).laboratory.events
    assert abs(len(events) - sum(map(len, truth.values()))) <= 6
    said = works("gait", written, "--write", "again.c3d", "--out", "two")
    assert "by the file" in said
    assert "markers" not in next(line for line in said.splitlines() if "events:" in line)
    again = study.read_recording(tmp_path / "two" / "again.c3d").laboratory.events
    assert [event[:2] for event in again] == [event[:2] for event in events]
    np.testing.assert_allclose([event.time for event in again], [event.time for event in events], atol=1e-5)
    refused("gait", source, "--write", "events.csv", says="events are written to .c3d")
