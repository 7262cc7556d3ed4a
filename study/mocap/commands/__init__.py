"""The commands on recordings: each reads a file, calls the library, prints what was found and names what it wrote."""

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from study.mocap.markersets.match import Match
    from study.mocap.skeleton.calibration import Calibration

File = Annotated[Path, typer.Argument(metavar="FILE", help="a recording: .c3d, .trc, .csv, .tsv or .txt")]
MarkerSet = Annotated[
    str | None, typer.Option("--markerset", help="name or file of a marker set [default: the one that fits best]")
]
Unit = Annotated[str | None, typer.Option("--unit", help="m, cm, mm, in or ft, where the file is wrong or silent")]
Rate = Annotated[float | None, typer.Option("--rate", help="frames per second, where the file is wrong or silent")]
Subject = Annotated[str | None, typer.Option("--subject", help="whose markers to take, where there are several")]
Out = Annotated[
    Path | None, typer.Option("--out", help="folder for what is written [default: results/recordings/<name>]")
]


def recording(file: File, unit: Unit = None, rate: Rate = None, subject: Subject = None) -> None:
    """Say what is in a recording: markers, frames, rate, and the gaps of each marker."""
    from study.mocap.io.describe import describe
    from study.mocap.io.reading import read_recording
    from study.mocap.markersets.match import choose
    from study.mocap.markersets.set_file import MarkerSetError

    found = read_recording(file, unit=unit, rate=rate, subject=subject)
    _print(describe(found))
    try:
        _print(choose(found).lines())
    except MarkerSetError as error:  # a recording of something else can be looked at, too
        typer.echo(str(error).removeprefix(f"{found.name}: "))


def joints(
    file: File,
    markerset: MarkerSet = None,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    out: Out = None,
) -> None:
    """Find the joints of a recording: phase 1; a table of them, and a calibration that draws other recordings."""
    from study.mocap.commands.open_recording import folder_for, opened
    from study.mocap.joints.fit_joints import find_joints
    from study.mocap.joints.joint_report import agreed, printed
    from study.mocap.joints.joint_table import joint_table
    from study.mocap.joints.method_agreement import agreement_table
    from study.mocap.skeleton.phases import calibrated
    from study.runs.storage.atomic_write import save_frame

    match = opened(file, markerset, unit, rate, subject)
    folder = folder_for(match.source.name, out)
    _say(match)
    found = find_joints(match.markerset, match.recording)
    _print(printed(found))
    compared = agreement_table(found, match.recording)
    _print(agreed(compared))
    save_frame(joint_table(found).merge(compared, on="joint"), folder / "joints.parquet")
    typer.echo(str(folder / "joints.parquet"))
    typer.echo(str(calibrated(found, match.recording).save(folder / "calibration.json")))


def skeleton(
    file: File,
    calibrated: Annotated[
        Path | None,
        typer.Option("--calibration", help="of the same subject: calibration.json, or the folder that it is in"),
    ] = None,
    markerset: MarkerSet = None,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    out: Out = None,
    video: Annotated[bool, typer.Option("--video", help="write motion.mp4, too")] = False,
) -> None:
    """Draw the skeleton in every frame: phase 2; tables, BVH, a figure, and a page with the moving skeleton."""
    from study.figures.style import save
    from study.mocap.commands.open_recording import folder_for
    from study.mocap.skeleton import skeleton_table
    from study.mocap.skeleton.bvh import write_bvh
    from study.mocap.skeleton.frames import draw_skeleton
    from study.mocap.skeleton.phases import require_same_subject, skeleton_scene
    from study.mocap.view import fig1_skeleton
    from study.mocap.view import video as film
    from study.mocap.view.motion_json import write_motion
    from study.mocap.view.webpage import write_viewer
    from study.runs.storage.atomic_write import save_frame

    if video:
        film.encoder()  # is told before the work is done
    match, made = _calibrated(calibrated, file, markerset, unit, rate, subject)
    folder = folder_for(match.source.name, out)
    _say(match)
    drawn = require_same_subject(draw_skeleton(made, match.recording))
    scene = skeleton_scene(drawn, match.recording)
    _print(skeleton_table.printed(scene))
    save_frame(skeleton_table.skeleton_table(scene), folder / "skeleton.parquet")
    save_frame(skeleton_table.bone_table(scene), folder / "bones.parquet")
    paths = [folder / "skeleton.parquet", folder / "bones.parquet"]
    if calibrated is None:
        paths.append(made.save(folder / "calibration.json"))
    paths.append(write_bvh(drawn, folder / "skeleton.bvh"))
    paths.append(write_motion(scene, folder / "motion.json"))
    paths += save(fig1_skeleton.draw(fig1_skeleton.prepare(scene)), folder / "fig1_skeleton")
    paths.append(write_viewer(scene, folder / "viewer.html"))
    _print(map(str, paths))
    if video:
        with typer.progressbar(length=1000, label="video", file=sys.stderr, hidden=not sys.stderr.isatty()) as bar:
            done = [0.0]

            def advance(share: float) -> None:
                before, done[0] = done[0], done[0] + 1000 * share
                bar.update(int(done[0]) - int(before))

            path = film.write_video(scene, folder / "motion.mp4", advance=advance)
        typer.echo(str(path))


def case_study(
    file: File,
    markerset: MarkerSet = None,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    out: Out = None,
    subsets: Annotated[int, typer.Option("--subsets", help="of each size and joint, a multiple of four")] = 400,
    seed: Annotated[int, typer.Option("--seed", help="of the subsets")] = 1,
) -> None:
    """Repeat the paper's precision study, section 9.1: every joint from many parts of a recording; figure 7."""
    from study.figures.style import save
    from study.mocap.case_study import fig7_case, precision_study
    from study.mocap.commands.open_recording import folder_for, opened
    from study.mocap.io.origin import digest_of, with_origin
    from study.mocap.joints.fit_joints import find_joints
    from study.runs.storage.atomic_write import save_frame

    match, digest = opened(file, markerset, unit, rate, subject), digest_of(file)
    folder = folder_for(match.source.name, out)
    _say(match)
    case = precision_study.case_study(find_joints(match.markerset, match.recording), match.recording, subsets, seed)
    _print(fig7_case.words(case))
    for name, table in {"scatter": case.scatter, "joints": case.joints, "laws": case.laws}.items():
        save_frame(with_origin(table, case.recording, digest), folder / f"case-study-{name}.parquet")
        typer.echo(str(folder / f"case-study-{name}.parquet"))
    _print(map(str, save(fig7_case.draw(fig7_case.prepare(case)), folder / "fig7_case")))


def synthetic(
    out: Annotated[
        Path | None,
        typer.Option("--out", help=".c3d or .csv [default: results/recordings/synthetic-<seed>/synthetic-<seed>.c3d]"),
    ] = None,
    frames: Annotated[int, typer.Option("--frames", help="how many")] = 3000,
    rate: Annotated[float, typer.Option("--rate", help="frames per second")] = 120.0,
    seed: Annotated[int, typer.Option("--seed", help="of all that is random")] = 1,
    noise: Annotated[float, typer.Option("--noise", help="standard deviation of a coordinate, metres")] = 0.001,
    soft_tissue: Annotated[float, typer.Option("--soft-tissue", help="how far skin slides at most, metres")] = 0.0,
    gaps: Annotated[float, typer.Option("--gaps", help="share of each marker's samples that are missing")] = 0.0,
    swaps: Annotated[float, typer.Option("--swaps", help="share of frames with two markers exchanged")] = 0.0,
    height: Annotated[float, typer.Option("--height", help="of the body, metres: another subject")] = 1.75,
    reach: Annotated[float, typer.Option("--reach", help="share of the natural range of motion")] = 1.0,
    independent: Annotated[bool, typer.Option("--independent", help="every frame a pose drawn anew")] = False,
) -> None:
    """Make a recording of an articulated figure, and tables of its true joints beside it."""
    from study.mocap.commands.open_recording import folder_for
    from study.mocap.synthetic.export import write_recording, write_truth
    from study.mocap.synthetic.synthesize import Recipe, synthesize

    recipe = Recipe(frames, rate, seed, noise, soft_tissue, gaps, swaps, height, reach, independent)
    made, truth = synthesize(recipe)
    path = write_recording(made, out or folder_for(made.name) / f"{made.name}.c3d")
    _print(map(str, (path, *write_truth(truth, path))))


def fetch(
    library: Annotated[str, typer.Argument(metavar="LIBRARY", help="cmu")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="of the recording, such as 60_08: subject and trial")],
) -> None:
    """Get a recording from a public library, once; print where it is."""
    from study.mocap.io import fetch as library_of

    try:
        path = library_of.fetch(library, name)
    except library_of.DownloadError as error:  # a failure, not a mistake in what was asked for
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from None
    typer.echo(f"{library}: {library_of.LIBRARIES[library].terms}", err=True)
    typer.echo(str(path))


def _calibrated(
    calibrated: Path | None,
    file: Path,
    markerset: str | None,
    unit: str | None,
    rate: float | None,
    subject: str | None,
) -> "tuple[Match, Calibration]":
    """A recording, and a calibration: the one that is given, or one that is fitted to the recording itself."""
    from study.mocap.commands.open_recording import opened
    from study.mocap.io.reading import read_recording
    from study.mocap.markersets.match import match
    from study.mocap.skeleton.calibration import load_calibration
    from study.mocap.skeleton.phases import calibrate

    if calibrated is None:
        found = opened(file, markerset, unit, rate, subject)
        return found, calibrate(found.recording, found.markerset)
    if markerset is not None:
        raise typer.BadParameter(f"--markerset {markerset}: a calibration has its own marker set; leave it out")
    made = load_calibration(calibrated / "calibration.json" if calibrated.is_dir() else calibrated)
    return match(made.markerset, read_recording(file, unit=unit, rate=rate, subject=subject)), made


def _say(match: "Match") -> None:
    """What a user should know of how a recording was read, and of the marker set on it."""
    _print(f"note: {note}" for note in match.source.notes)
    _print(match.lines())


def _print(lines: Iterable[str]) -> None:
    for line in lines:
        typer.echo(line)
