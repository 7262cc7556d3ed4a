"""The command `study skeleton`: phase 2, the skeleton of a recording in every frame.

The command `study fetch`: a recording from a public library.

The command `study markersets`: the marker sets that come with the program.

The command `study recording`: the contents of a recording.

The output of `study skeleton`: its options, its files, and what is printed of them.

The command `study synthetic`: a recording of a body whose joints are known.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from study.options import Json
from study.recordings.commands.options import File, MarkerSetName, Out, Reading, grouped
from study.recordings.synthetic.recipe import SKIN, Recipe

if TYPE_CHECKING:
    from collections.abc import Sequence

    from study.recordings.export.tree import ExportedMotion
    from study.recordings.markersets.match import Match
    from study.recordings.skeleton.calibration import Calibration
    from study.recordings.skeleton.scene import Scene


def fetch(
    library: Annotated[str, typer.Argument(metavar="LIBRARY", help="cmu")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="subject and trial of the recording, such as 60_08")],
    as_json: Json = False,
) -> None:
    """Download a recording from a public library.

    Prints its path in the cache; a recording that is there is not downloaded again.

    With --json: library, name, file and terms.
    """
    from study.recordings.formats import write
    from study.text import json_text

    try:
        path = write.fetch(library, name)
    except write.DownloadError as error:  # a failure, not a mistake of the user
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from None
    terms = write.LIBRARIES[library].terms
    if as_json:
        typer.echo(json_text({"library": library, "name": name, "file": path, "terms": terms}))
        return
    typer.echo(f"{library}: {terms}", err=True)
    typer.echo(str(path))


def markersets(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="print this one [default: list all]")] = None,
    as_json: Json = False,
) -> None:
    """List the shipped marker sets, or print one.

    `study markersets cmu41 > mine.toml` is a start for a marker set of your own, which --markerset mine.toml uses.

    With --json: markersets, each with name, about, segments, joints, optional and aliases.
    """
    from study.recordings.commands.common import markerset_data, print_lines
    from study.recordings.markersets import described, load_markerset, shipped, shipped_text
    from study.text import json_text

    if as_json:
        names = shipped() if name is None else [name]
        typer.echo(json_text({"markersets": [markerset_data(load_markerset(each)) for each in names]}))
    elif name is None:
        print_lines(described())
    else:
        typer.echo(shipped_text(name), nl=False)


@grouped
def recording(file: File, *, as_json: Json = False, reading: Reading) -> None:
    """Describe a recording.

    Prints its markers, frames and rate, the gaps of each marker, and the marker set that fits best.

    With --json: recording, rate, frames, duration, missing, notes, markers and markerset (null if none fits).
    """
    from study.recordings.commands.common import print_lines, recording_data
    from study.recordings.markersets import MarkerSetError
    from study.recordings.markersets.match import choose
    from study.recordings.recording import describe
    from study.text import json_text

    found = reading.read(file)
    try:
        match, reason = choose(found), ""
    except MarkerSetError as error:  # a recording that no marker set fits can be described, too
        match, reason = None, str(error).removeprefix(f"{found.name}: ")
    if as_json:
        typer.echo(json_text(recording_data(found, match)))
    else:
        print_lines([*describe(found), *([reason] if match is None else match.lines())])


@dataclass(frozen=True)
class Output:
    """The options that say what to write and to print."""

    write: str | None = field(
        default=None,
        metadata={
            "help": "further files, with commas between them: names that end in .c3d, .trc (markers and joint "
            "centres), .glb, .bvh (animated bones), .mot (joint angles) or .csv (table), or the endings alone"
        },
    )
    rest: Literal["t-pose", "recorded"] = field(
        default="t-pose",
        metadata={
            "help": "the pose of .bvh and .glb in which all rotations are zero: a T-pose, or one of the recording"
        },
    )
    video: bool = field(default=False, metadata={"help": "also write motion.mp4"})
    json: bool = field(default=False, metadata={"help": "print one JSON object, with null where there is no number"})


def written_files(motion: "ExportedMotion", folder: Path) -> Iterator[Path]:
    """Write the tables, the hierarchy, the pictures and pages of a skeleton; yields each path when the file is there.

    A hierarchy needs its root. Where no frame shows it, a message says so, and all else is written.
    """
    from study.files import save_frame
    from study.recordings.export import write_file
    from study.recordings.export.tree import joint_angles
    from study.recordings.recording import RecordingError
    from study.recordings.skeleton import make_scene
    from study.recordings.view import figure
    from study.recordings.view.webpage import write_motion, write_viewer
    from study.style import save

    tables = {
        "skeleton": make_scene.skeleton_table(motion.scene),
        "bones": make_scene.bone_table(motion.scene),
        "angles": joint_angles(motion),
    }
    for name, table in tables.items():
        save_frame(table, folder / f"{name}.parquet")
        yield folder / f"{name}.parquet"
    try:
        yield write_file(motion, folder / "skeleton.bvh")
    except RecordingError as error:
        typer.echo(f"{folder / 'skeleton.bvh'} is not written: {error}", err=True)
    yield write_motion(motion.scene, folder / "motion.json")
    yield from save(figure.draw(figure.prepare(motion.scene)), folder / "fig1_skeleton")
    yield write_viewer(motion.scene, folder / "viewer.html")


def write_motion_video(scene: "Scene", path: Path) -> Path:
    """Write the video, with a progress bar on a terminal."""
    from study.recordings.view.video import write_video
    from study.text import unchanged

    raw = unchanged(sys.stderr)
    with typer.progressbar(length=1000, label="video", file=raw, hidden=not raw.isatty()) as bar:
        done = 0.0

        def advance(share: float) -> None:
            nonlocal done
            before, done = done, done + 1000 * share
            bar.update(int(done) - int(before))

        return write_video(scene, path, advance=advance)


@dataclass(frozen=True)
class Given:
    """The options on a calibration that is given."""

    calibration: Path | None = field(
        default=None, metadata={"help": "calibration.json of the same subject, or its folder [default: calibrate here]"}
    )
    force: bool = field(
        default=False, metadata={"help": "use the calibration even if it seems to be of another subject"}
    )
    refit: bool = field(
        default=False, metadata={"help": "fit the calibration's segment shapes to this recording; its joints stay"}
    )

    def require_sense(self) -> None:
        """Refuse options that say how to use a calibration where none is given."""
        if self.calibration is None and self.force:
            raise typer.BadParameter("--force: there is nothing to overrule without --calibration")
        if self.calibration is None and self.refit:
            raise typer.BadParameter("--refit: there are no shapes to refit without --calibration")


@grouped
def skeleton(
    file: File,
    *,
    given: Given,
    markerset: MarkerSetName = None,
    out: Out = None,
    output: Output,
    reading: Reading,
) -> None:
    """Draw the skeleton in every frame: phase 2.

    Writes tables, BVH, a figure, and a page that shows the moving skeleton; with --write also files for other programs.

    With --json: recording, rate, frames, source of the joints; joints, each with its doubt, error, shares of the frames
    in which it is seen, bridged, unknown and outside of the markers' hull, and the distance; bones, each with length,
    spread, error and uneven; notes, overruled and files.
    """
    from study.recordings.commands.common import print_lines, print_match, results_folder
    from study.recordings.export import planned_files
    from study.recordings.export.tree import ExportedMotion, RestPose
    from study.recordings.recording import printable
    from study.recordings.session import refit_shapes
    from study.recordings.skeleton.calibrate import overruled, require_same_subject
    from study.recordings.skeleton.draw import draw_skeleton
    from study.recordings.skeleton.make_scene import skeleton_data, skeleton_lines, skeleton_scene
    from study.recordings.view.video import encoder
    from study.text import json_text

    given.require_sense()
    if output.video:
        encoder()  # so that a missing one is reported before the work is done
    name = printable(file.stem)
    folder = results_folder(name, out)
    further = planned_files(output.write or "", folder, name, file)
    match, used = _calibrated(file, reading, given.calibration, markerset)
    if not output.json:
        print_match(match)
        print_lines(used.lines())
    drawn = draw_skeleton(used, match.recording)
    remarks = overruled(drawn) if given.force else []
    drawn = drawn if given.force else require_same_subject(drawn)
    if given.refit:
        used = refit_shapes(used, match.recording)
        drawn = draw_skeleton(used, match.recording)
    scene = skeleton_scene(drawn, match.recording)
    if not output.json:
        print_lines([*remarks, *skeleton_lines(scene)])
    motion = ExportedMotion(drawn, match.source, scene, file, RestPose(output.rest))
    paths: list[Path] = []
    for path in _written(motion, output, folder, [] if given.calibration else [used], further):
        paths.append(path)
        print_lines([] if output.json else [path])
    if output.json:
        typer.echo(json_text(skeleton_data(scene) | {"overruled": remarks, "files": paths}))


def _written(
    motion: "ExportedMotion", output: Output, folder: Path, own: "Sequence[Calibration]", further: "Sequence[Path]"
) -> "Iterator[Path]":
    """Write all files; yields the path of each when it is there."""
    from study.recordings.export import write_file
    from study.recordings.skeleton.calibration import save_calibration

    yield from (save_calibration(calibration, folder / "calibration.json") for calibration in own)
    yield from written_files(motion, folder)
    yield from (write_file(motion, path) for path in further)
    if output.video:
        yield write_motion_video(motion.scene, folder / "motion.mp4")


def _calibrated(
    file: Path, reading: Reading, calibration: Path | None, markerset: str | None
) -> "tuple[Match, Calibration]":
    """A recording, and the given calibration, or one that is fitted to the recording itself."""
    from study.recordings.commands.common import open_recording
    from study.recordings.markersets.match import match
    from study.recordings.skeleton.calibrate import calibrate
    from study.recordings.skeleton.calibration import load_calibration

    if calibration is None:
        found = open_recording(file, markerset, reading)
        return found, calibrate(found.recording, found.markerset)
    if markerset is not None:
        raise typer.BadParameter(f"--markerset {markerset}: a calibration has its own marker set; leave it out")
    used = load_calibration(calibration / "calibration.json" if calibration.is_dir() else calibration)
    return match(used.markerset, reading.read(file)), used


SyntheticOut = Annotated[
    Path | None,
    typer.Option(
        "--out", help=".c3d, .trc or .csv [default: results/recordings/synthetic-<seed>/synthetic-<seed>.c3d]"
    ),
]


@grouped
def synthetic(*, out: SyntheticOut = None, as_json: Json = False, recipe: Recipe) -> None:
    """Make a recording of a synthetic body.

    Writes the recording, and tables of the true joints beside it. With --json: recording, frames, rate and files.
    """
    from study.recordings.commands.common import print_lines, results_folder
    from study.recordings.formats.write import write_recording
    from study.recordings.recording import RecordingError
    from study.recordings.synthetic.make import synthesize, write_truth
    from study.text import json_text

    if recipe.skin != SKIN[0] and not recipe.soft_tissue:
        raise RecordingError(f"--skin {recipe.skin}: skin moves by 0 m; give its largest motion with --soft-tissue")
    made, truth = synthesize(recipe)
    path = write_recording(made, out or results_folder(made.name) / f"{made.name}.c3d")
    paths = [path, *write_truth(truth, path)]
    data = {"recording": made.name, "frames": made.frames, "rate": made.rate, "files": paths}
    print_lines([json_text(data)] if as_json else paths)
