"""The command `study joint`: one joint between two clusters of markers, without a marker set."""

from typing import Annotated

import typer

from study.mocap.commands.options import File, Reading, grouped
from study.runs.commands import ExitCode

Parent = Annotated[
    str, typer.Option("--parent", metavar="A,B,C", help="labels of three or more markers of the parent segment")
]
Child = Annotated[
    str,
    typer.Option(
        "--child", metavar="D,E,F", help="labels of markers of the child segment, which rotates about the joint"
    ),
]
Hinge = Annotated[bool, typer.Option("--hinge", help="the joint is a hinge, such as a knee or an elbow")]
Across = Annotated[
    str, typer.Option("--across", metavar="G,H", help="lateral and medial point, midway between which a hinge lies")
]
Json = Annotated[bool, typer.Option("--json", help="print the joint as JSON, in metres and degrees")]


@grouped
def joint(
    file: File,
    *,
    parent: Parent,
    child: Child,
    hinge: Hinge = False,
    across: Across = "",
    as_json: Json = False,
    reading: Reading,
) -> None:
    """Find one joint, from the markers of its two segments.

    Prints one line, and compares with joint centres that other programs left in the file. The exit code is 3 if the
    joint is not ok.
    """
    from study.mocap.commands.open_recording import print_lines
    from study.mocap.one_joint.clusters import find_clusters
    from study.mocap.one_joint.joint_line import joint_json, joint_line
    from study.mocap.one_joint.one_joint import fit_one_joint

    if across and not hinge:
        raise typer.BadParameter("--across: only a hinge has an axis; give --hinge, too")
    recording = reading.read(file)
    found = fit_one_joint(recording, find_clusters(recording, parent, child, across), hinge)
    if as_json:
        typer.echo(joint_json(found))
    else:
        print_lines(f"note: {note}" for note in recording.notes)
        print_lines([joint_line(found)])
    if not found.ok:
        raise typer.Exit(ExitCode.TOO_MANY_FAILURES)
