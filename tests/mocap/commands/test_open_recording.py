"""The folder for the results of a recording."""

from pathlib import Path

import pytest

from study.mocap.commands.open_recording import results_folder
from study.mocap.io.recording import RecordingError


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("walk 1", "walk-1"),
        ("..", "recording"),
        ("../../etc/passwd", "etc-passwd"),
        ("/", "recording"),
        (".hidden", "hidden"),
        ("größe", "größe"),
        ("a\x00b\n", "a-b"),
        ("x" * 300, "x" * 100),
        ("C:\\run", "C-run"),
        ("", "recording"),
    ],
)
def test_folders(name, folder):
    """For any name of a recording, its folder is directly below that of results."""
    assert results_folder(name) == Path("results/recordings") / folder
    assert results_folder(name, Path("mine")) == Path("mine")


def test_a_file_is_no_folder(tmp_path):
    """A file in the folder's place is refused."""
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="is a file, not a folder; choose another with --out"):
        results_folder("a", tmp_path / "file")
