"""Commands on whole recordings: `study skeleton` (phase 2), `study recording` and `study markersets` to look at one.

`study fetch` downloads one, `study synthetic` makes one of a body whose joints are known.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from study.options import Json, echo, unchanged
from study.recordings.commands import (
    File,
    FrameRange,
    HipCentres,
    MarkerSetName,
    Out,
    Rate,
    Subject,
    Unit,
    print_match,
    results_folder,
)

if TYPE_CHECKING:
    from study.recordings.export.tree import ExportedMotion
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
    terms = write.LIBRARIES[library]
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
    from study.recordings.markersets import described, load_markerset, shipped, shipped_text
    from study.text import json_text

    if as_json:
        names = shipped() if name is None else [name]
        typer.echo(json_text({"markersets": [load_markerset(word).model_dump() for word in names]}))
    elif name is None:
        echo(described())
    else:
        typer.echo(shipped_text(name), nl=False)


def recording(
    file: File,
    as_json: Json = False,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    frames: FrameRange = None,
) -> None:
    """Describe a recording.

    Prints its markers, frames and rate, the gaps of each marker, and the marker set that fits best.

    With --json: recording, rate, frames, duration, missing, notes, markers, whole and markerset (null if none fits).
    """
    from study.recordings.formats.read import read_recording
    from study.recordings.markersets import MarkerSetError, choose
    from study.recordings.recording import describe, recording_data
    from study.text import json_text

    source = read_recording(file, unit=unit, rate=rate, subject=subject, frames=frames)
    try:
        match, reason = choose(source), ""
    except MarkerSetError as error:  # a recording that no marker set fits can be described, too
        match, reason = None, str(error).removeprefix(f"{source.name}: ")
    if as_json:
        typer.echo(json_text(recording_data(source) | {"markerset": match.data() if match else None}))
    else:
        echo([*describe(source), *([reason] if match is None else match.lines())])


def written_files(motion: "ExportedMotion", folder: Path) -> Iterator[Path]:
    """Write the tables, the hierarchy, the pictures and pages of a skeleton; yields each path when the file is there.

    A hierarchy needs its root. Where no frame shows it, a message says so, and all else is written.
    """
    from study.files import save_frame
    from study.recordings.export import write_file
    from study.recordings.export.tree import joint_angles
    from study.recordings.recording import RecordingError
    from study.recordings.skeleton import scene
    from study.recordings.view import figure
    from study.recordings.view.webpage import write_motion, write_viewer
    from study.style import save

    tables = {
        "skeleton": scene.skeleton_table(motion.scene),
        "bones": scene.bone_table(motion.scene),
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
    yield from save(figure.draw(motion.scene), folder / "fig1_skeleton")
    yield write_viewer(motion.scene, folder / "viewer.html")


def write_motion_video(scene: "Scene", path: Path) -> Path:
    """Write the video, with a progress bar on a terminal."""
    from study.recordings.view.figure import write_video

    raw = unchanged(sys.stderr)
    with typer.progressbar(length=1000, label="video", file=raw, hidden=not raw.isatty()) as bar:
        done = 0.0

        def advance(share: float) -> None:
            nonlocal done
            before, done = done, done + 1000 * share
            bar.update(int(done) - int(before))

        return write_video(scene, path, advance=advance)


_CALIBRATION = "calibration.json of the same subject, or its folder [default: calibrate here]"
CalibrationFile = Annotated[Path | None, typer.Option("--calibration", help=_CALIBRATION)]
_FORCE = "use the calibration even if it seems to be of another subject"
Force = Annotated[bool, typer.Option("--force", help=_FORCE)]
_REFIT = "fit the calibration's segment shapes to this recording; its joints stay"
Refit = Annotated[bool, typer.Option("--refit", help=_REFIT)]
_WRITE = (
    "further files, with commas between them: names that end in .c3d, .trc (markers and joint centres), .glb, .bvh "
    "(animated bones), .mot (joint angles) or .csv (table), or the endings alone"
)
Write = Annotated[str | None, typer.Option("--write", help=_WRITE)]
_REST = "the pose of .bvh and .glb in which all rotations are zero: a T-pose, or one of the recording"
Rest = Annotated[Literal["t-pose", "recorded"], typer.Option("--rest", help=_REST)]
Video = Annotated[bool, typer.Option("--video", help="also write motion.mp4")]


def skeleton(
    file: File,
    calibration: CalibrationFile = None,
    force: Force = False,
    refit: Refit = False,
    hips: HipCentres = "motion",
    markerset: MarkerSetName = None,
    out: Out = None,
    write: Write = None,
    rest: Rest = "t-pose",
    video: Video = False,
    as_json: Json = False,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    frames: FrameRange = None,
) -> None:
    """Draw the skeleton in every frame: phase 2.

    Writes tables, BVH, a figure, and a page that shows the moving skeleton; with --write also files for other programs.

    With --json: recording, rate, frames, source of the joints; joints, each with its doubt, error, shares of the frames
    in which it is seen, bridged, unknown and outside of the markers' hull, and the distance; bones, each with length,
    spread, error and uneven; notes, angles (what they are), overruled and files.
    """
    from study.recordings.export import planned_files, write_file
    from study.recordings.export.tree import ExportedMotion, RestPose, angle_lines
    from study.recordings.formats.read import read_recording
    from study.recordings.joints.find import save_calibration
    from study.recordings.recording import printable
    from study.recordings.session import refit_shapes
    from study.recordings.skeleton.anatomy import regression_hint
    from study.recordings.skeleton.calibrate import require_same_subject, with_joints
    from study.recordings.skeleton.draw import draw_skeleton
    from study.recordings.skeleton.scene import skeleton_data, skeleton_lines, skeleton_scene
    from study.recordings.view.figure import encoder
    from study.text import json_text

    if calibration is None and force:
        raise typer.BadParameter("--force: there is nothing to overrule without --calibration")
    if calibration is None and refit:
        raise typer.BadParameter("--refit: there are no shapes to refit without --calibration")
    if calibration is not None and hips != "motion":
        raise typer.BadParameter("--hips regression: a calibration has its hips; give the option to `study joints`")
    if calibration is not None and markerset is not None:
        raise typer.BadParameter(f"--markerset {markerset}: a calibration has its own marker set; leave it out")
    if video:
        encoder()  # so that a missing one is reported before the work is done
    name = printable(file.stem)
    folder = results_folder(name, out)
    further = planned_files(write or "", folder, name, file)
    source = read_recording(file, unit=unit, rate=rate, subject=subject, frames=frames)
    match, used = with_joints(source, calibration, markerset, hips)
    if not as_json:
        print_match(match, calibration is not None)
        echo([*used.lines(), *(regression_hint(used, source) if calibration is None else [])])
    remarks = [] if calibration is None else require_same_subject(used, match.recording, refit, force)
    used = refit_shapes(used, match.recording) if refit else used
    drawn = draw_skeleton(used, match.recording)
    scene = skeleton_scene(drawn, match.recording, remarks)
    if not as_json:
        echo([*skeleton_lines(scene), *angle_lines(used)])
    motion = ExportedMotion(drawn, match.source, scene, file, RestPose(rest))

    def written() -> Iterator[Path]:
        if calibration is None:
            yield save_calibration(used, folder / "calibration.json")
        yield from written_files(motion, folder)
        yield from (write_file(motion, path) for path in further)
        if video:
            yield write_motion_video(scene, folder / "motion.mp4")

    paths: list[Path] = []
    for path in written():
        paths.append(path)
        echo([] if as_json else [path])
    if as_json:
        typer.echo(
            json_text(skeleton_data(scene) | {"angles": angle_lines(used), "overruled": remarks, "files": paths})
        )


_OUT = ".c3d, .trc or .csv [default: results/recordings/synthetic-<seed>/synthetic-<seed>.c3d]"
SyntheticOut = Annotated[Path | None, typer.Option("--out", help=_OUT)]
Frames = Annotated[int, typer.Option("--frames", help="number of frames")]
SyntheticRate = Annotated[float, typer.Option("--rate", help="frames per second")]
Seed = Annotated[int, typer.Option("--seed", help="seed of all random numbers")]
Noise = Annotated[float, typer.Option("--noise", help="standard deviation of a marker's coordinate, metres")]
SoftTissue = Annotated[float, typer.Option("--soft-tissue", help="largest soft-tissue artefact of a marker, metres")]
_SKIN = "law of the soft-tissue artefact: mixed, random, angle, velocity, cluster, slide"
Skin = Annotated[str, typer.Option("--skin", help=_SKIN)]
Gaps = Annotated[float, typer.Option("--gaps", help="share of each marker's samples that are missing")]
Swaps = Annotated[float, typer.Option("--swaps", help="share of the frames in which two markers are exchanged")]
_HEIGHT = "height of the body, metres; another height gives another subject"
Height = Annotated[float, typer.Option("--height", help=_HEIGHT)]
Reach = Annotated[float, typer.Option("--reach", help="share of the natural range of motion")]
Independent = Annotated[bool, typer.Option("--independent", help="draw each frame anew instead of a smooth motion")]
_GAIT = "move as in walking: in strides, little out of the sagittal plane"
Gait = Annotated[bool, typer.Option("--gait", help=_GAIT)]
_MARKERS = "marker set that the body wears: cmu41, or rizzoli, the landmarks of trunk and legs"
Markers = Annotated[str, typer.Option("--markers", help=_MARKERS)]


def synthetic(
    out: SyntheticOut = None,
    as_json: Json = False,
    frames: Frames = 3000,
    rate: SyntheticRate = 120.0,
    seed: Seed = 1,
    noise: Noise = 0.001,
    soft_tissue: SoftTissue = 0.0,
    skin: Skin = "mixed",
    gaps: Gaps = 0.0,
    swaps: Swaps = 0.0,
    height: Height = 1.75,
    reach: Reach = 1.0,
    independent: Independent = False,
    gait: Gait = False,
    markers: Markers = "cmu41",
) -> None:
    """Make a recording of a synthetic body.

    Writes the recording, and tables of the true joints beside it. With --json: recording, frames, rate and files.
    """
    from study.recordings.formats.write import write_recording
    from study.recordings.recording import RecordingError
    from study.recordings.synthetic.make import Recipe, synthesize, write_truth
    from study.text import json_text

    numbers = frames, rate, seed, noise, soft_tissue, skin, gaps, swaps, height, reach
    recipe = Recipe(*numbers, independent=independent, gait=gait, markers=markers)
    if skin != "mixed" and not soft_tissue:
        raise RecordingError(f"--skin {skin}: skin moves by 0 m; give its largest motion with --soft-tissue")
    made, truth = synthesize(recipe)
    path = write_recording(made, out or results_folder(made.name) / f"{made.name}.c3d")
    paths = [path, *write_truth(truth, path)]
    data = {"recording": made.name, "frames": made.frames, "rate": made.rate, "files": paths}
    echo([json_text(data)] if as_json else paths)
