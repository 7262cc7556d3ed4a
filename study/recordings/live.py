"""Joints that grow with the frames of a stream, in constant memory: incremental fits of the paper's section 4.

Each line of a stream is a frame, a JSON object of labels and positions, ``{"LASI": [412.1, 680.3, 966.2], ...}``. A
marker that is not seen is left out, or null. Blank lines are skipped.

The pose of a parent segment comes from a rigid fit of its markers to their shape in the most typical of the first
frames with all of them. In its axes each marker of the child adds to a `study.Incremental`, and MGDK's centre follows
from all of them. Frames in which a marker jumps are left out, since one would spoil the moments for ever. The noise is
taken for the same in all directions, which that of a pose is not, and no second side is checked: a finished recording
is for `study joint`, which does both.

Source: paper §4 (IGDK), eqs 22-25.
"""

import json
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from study.arrays import Floats
from study.fits.answers.markers import Incremental, JointFit, mgdk_so_far
from study.fits.points.samples import Status
from study.recordings.joints.estimate import CENTIMETRE, largest_error
from study.recordings.recording import RecordingError
from study.recordings.rigid import fit_rigid_motion, to_local

_LARGEST = 65536
"""Bytes of the largest datagram."""


class FrameError(Exception):
    """A line that is not a frame; the message, one line, says why."""


def read_frame(line: str, unit: float) -> dict[str, Floats]:
    """Read a frame from its line.

    Args:
        line: JSON.
        unit: metres per unit of its numbers.

    Returns:
        The place of each marker that is seen (3,), metres.

    Raises:
        FrameError: if the line is no JSON object, or a position is not three finite numbers.
    """
    try:
        values = json.loads(line)
    except (ValueError, RecursionError):
        raise FrameError("no JSON") from None
    if not isinstance(values, dict):
        raise FrameError('not an object of labels and positions, such as {"LASI": [412, 680, 966]}')
    frame = {label: place for label, place in values.items() if place is not None}
    for label, x in frame.items():
        if not (isinstance(x, list) and len(x) == 3 and all(type(v) in (int, float) and abs(v) < 1e12 for v in x)):
            raise FrameError(f"the position of {label!r} is not three finite numbers")
    return {label: np.array(place, dtype=np.float64) * unit for label, place in frame.items()}


def lines_of_port(port: int, announce: Callable[[str], None]) -> Iterator[str]:
    """Lines of datagrams (UDP) that this machine sends to a port of its own, until an empty datagram.

    Args:
        port: its number; 0 for any free one.
        announce: receives the address, as soon as datagrams can be received.

    Raises:
        RecordingError: if the port cannot be used.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        try:
            receiver.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            reason = error.strerror if isinstance(error, OSError) else "a port is a number from 0 to 65535"
            raise RecordingError(f"--udp {port}: cannot be used: {reason}") from None
        announce(f"listening on 127.0.0.1:{receiver.getsockname()[1]}")
        while datagram := receiver.recv(_LARGEST):
            yield from datagram.decode("utf-8", "replace").splitlines()


_BLOCKS = 16
"""Most blocks of frames; a jackknife takes half as many."""
_BATCH = 25
"""Frames that are added at once: one by one takes ten times as long."""
_SHAPES = 5
"""Frames of which the most typical gives a segment its shape; fewer cannot outvote one that is wrong."""
_JUMP, _BENT = 10.0, 0.2
"""Times the usual distance, and share of a segment's size, from which its markers do not have its shape."""
_LABELS = 300
"""Labels that are remembered: a stream may have any number of them."""
_KEPT = 400
"""Frames, evenly spread, whose samples are kept to look for some that are far from the rest."""
_FAR, _FAR_OFF, _SOME = 6.0, 10.0, 1.0 / 300.0
"""Times the noise of most frames from which a distance between markers is far from its usual one, as one normal number
in 10⁹ is; from which one from the centre is, which is less sure in poses from few markers; and the share of such frames
that is doubted."""
_MOVED = np.radians(2.0)
"""Least root mean square angle of motion, along every direction, of a joint that is known."""


class GrowingSegment:
    """A parent segment: its shape once a few frames have shown all its markers.

    Args:
        rows: numbers of its markers, three or more, among those of all joints.

    Attributes:
        template: the shape (m, 3), metres; None as long as it is not known.
        size: root mean square distance of its markers from their centre, metres.
        jumps: number of frames left out because they show another shape.
        whole: the first few shapes of frames that show all markers.
        frame: number of the first of these frames, from 1, in which the segment's axes are the stream's; 0 before it.
    """

    def __init__(self, rows: Sequence[int]) -> None:
        self.rows = list(rows)
        self.template: Floats | None = None
        self.size, self.jumps = 0.0, 0
        self.whole: list[Floats] = []
        self.frame = self._frames = 0
        self._recent = np.empty(0)

    def poses(self, x: Floats) -> tuple[Floats, Floats]:
        """Rotations R (3, 3, n) and origins o (3, n) in n frames, x = R a + o, by its markers (m, 3, n), metres.

        They are NaN where a frame does not show the markers, or not in their shape.
        """
        if self.template is None:
            seen = np.flatnonzero(~np.isnan(x).any(axis=(0, 1)))
            self.frame = self.frame or (self._frames + int(seen[0]) + 1 if len(seen) else 0)
            self._frames += x.shape[2]
            self.whole += list(x.transpose(2, 0, 1)[seen])
            if len(self.whole) < _SHAPES:
                return np.full((3, 3, x.shape[2]), np.nan), np.full((3, x.shape[2]), np.nan)
            # the one whose distances between markers are nearest to those of most others
            shapes = np.array(self.whole)
            distances = np.linalg.norm(shapes[:, :, None] - shapes[:, None], axis=3).reshape(len(shapes), -1)
            apart = np.abs(distances[:, None] - distances[None]).max(axis=2)
            typical = shapes[np.argmin(np.median(apart, axis=1))]
            # in the axes that the stream has in the first of these frames, as `study joint` has them
            centred = typical - typical.mean(axis=0)
            turn = fit_rigid_motion(centred, np.ascontiguousarray(self.whole[0][:, :, None]))[0][:, :, 0]
            self.template = centred if np.isnan(turn).any() else centred @ turn.T
            self.size = float(np.sqrt(np.mean(np.sum(self.template**2, axis=1))))
        rotations, origins, known = fit_rigid_motion(self.template, x)
        if known.any():
            off = to_local(rotations, origins, x) - self.template[:, :, None]
            rms = np.sqrt(np.nanmean(np.sum(off[:, :, known] ** 2, axis=1), axis=0))
            self._recent = np.append(self._recent, rms)[-_BATCH:]
            bent = np.flatnonzero(known)[rms > max(_JUMP * float(np.median(self._recent)), _BENT * self.size)]
            rotations[:, :, bent], origins[:, bent] = np.nan, np.nan
            self.jumps += len(bent)
        return rotations, origins

    def axes_covariance(self, place: Floats) -> Floats:
        """Covariance (3, 3), metres², that its markers' noise in the named frame gives a place in its axes (3,)."""
        assert self.template is not None
        m = len(self.template)
        variance = float(np.median(self._recent)) ** 2 * m / (3 * m - 6)  # the shape has little noise beside a frame's
        outer = self.template.T @ self.template
        across = np.cross(np.eye(3), place)  # what a small turn does to the place
        turned = across.T @ np.linalg.pinv(np.trace(outer) * np.eye(3) - outer) @ across
        return np.asarray(variance * (turned + np.eye(3) / m))


class GrowingJoint:
    """A joint: the moments of its child's markers in the parent's axes, in blocks of successive frames.

    Frames in succession are much alike, so their number says little about the error. The blocks do: a jackknife over
    them repeats the fit without each (Quenouille 1949). When there are too many blocks, each two become one.

    Args:
        parent: the segment that holds it.
        rows: numbers of the child's markers among those of all joints.

    Attributes:
        jumps: number of samples left out because they are far from those before and after.
    """

    def __init__(self, parent: GrowingSegment, rows: Sequence[int]) -> None:
        self.parent, self.rows = parent, list(rows)
        self.blocks: list[list[Incremental]] = []
        self.batches, self.length, self.jumps = 0, 1, 0
        self._recent = self._kept = np.full((len(rows), 3, 0), np.nan)
        self._frames, self._stride = 0, 1

    def add(self, y: Floats) -> None:
        """Add a batch of frames: the child's markers in the parent's axes (m, 3, n), metres; NaN where missing.

        A sample much farther from its marker's middle than in most recent frames, and than the size of the joint, which
        a marker does not move in so few frames, is left out; before there are some frames to compare, all are.
        """
        recent = np.concatenate([self._recent, y], axis=2)
        self._recent = recent[:, :, -_BATCH:]
        center = median(recent)[:, :, None]
        usual = median(np.linalg.norm(recent - center, axis=1))
        size = np.maximum(self.parent.size, np.linalg.norm(center[:, :, 0], axis=1))
        jumps = np.linalg.norm(y - center, axis=1) > np.maximum(_JUMP * usual, size)[:, None]
        self.jumps += int(jumps.sum())
        few = np.sum(~np.isnan(recent[:, 0]), axis=1) < _SHAPES
        if self.batches == self.length * len(self.blocks):
            if len(self.blocks) == _BLOCKS:
                self.blocks = [merged(pair) for pair in zip(self.blocks[::2], self.blocks[1::2], strict=True)]
                self.length *= 2
            self.blocks.append([Incremental(3) for _ in self.rows])
        used = np.where((jumps | few[:, None])[:, None], np.nan, y)
        for part, points in zip(self.blocks[-1], used, strict=True):
            part.update(points.T)
        self._kept = np.concatenate([self._kept, used[:, :, -self._frames % self._stride :: self._stride]], axis=2)
        if self._kept.shape[2] > _KEPT:
            self._kept, self._stride = self._kept[:, :, ::2], 2 * self._stride
        self._frames += y.shape[2]
        self.batches += 1

    def _far(self, center: Floats) -> float:
        """Share of the kept frames with a distance far from its usual one, by the noise of most frames.

        Distances are those of the markers from the centre, and from each other, which no error of the centre changes.
        The noise is also that of differences between frames an eighth of the stream apart: a marker that is knocked
        halfway has two usual distances.
        """
        places = np.concatenate([self._kept, np.broadcast_to(center[:, None], (1, 3, self._kept.shape[2]))])
        one, other = np.triu_indices(len(places), 1)
        away = np.linalg.norm(places[one] - places[other], axis=1)
        apart = away.shape[1] // 8
        steps = np.abs(away[:, apart:] - away[:, : away.shape[1] - apart]) / np.sqrt(2.0)
        away = np.abs(away - median(away)[:, None])
        usual = np.fmin(median(away), median(steps)) / 0.6745
        most = np.where(other == len(self.rows), _FAR_OFF, _FAR) * usual
        return float(np.mean((away > most[:, None]).any(axis=0)))

    def answer(self) -> "LiveAnswer":
        """The joint as far as it is known."""
        whole = merged(self.blocks) if self.blocks else [Incremental(3)]
        fit, lack, covariance = mgdk_so_far(whole), "", np.full((3, 3), np.inf)
        if len(self.blocks) >= _BLOCKS // 2 and np.isfinite(fit.center).all():
            others = (merged([*self.blocks[:k], *self.blocks[k + 1 :]]) for k in range(len(self.blocks)))
            centers = np.array([mgdk_so_far(other).center for other in others])
            off = centers - centers.mean(axis=0)
            covariance = (1.0 - 1.0 / len(self.blocks)) * (off.T @ off) + self.parent.axes_covariance(fit.center)
        if self.parent.template is None:
            count = f"fewer than {_SHAPES} frames have" if self.parent.whole else "no frame has"
            lack = f"{count} all markers of its parent"
        elif not fit.count.any():
            lack = "no frame has a marker of its child and enough of its parent's"
        elif fit.own_status == Status.TOO_FEW_POINTS:
            lack = "too few frames"
        frame = 0 if self.parent.template is None else self.parent.frame
        far = self._far(fit.center) if np.isfinite(fit.center).all() else 0.0
        return LiveAnswer(replace(fit, covariance=covariance), rms_angles(whole, fit), lack, frame, far)


class LiveAnswer(NamedTuple):
    """A joint so far.

    Attributes:
        fit: in the parent's axes, metres.
        angles: root mean square angles of motion (3,), ascending.
        lack: reason why there are too few points, or "".
        frame: in which the parent's axes are those of the stream; 0 as long as the parent has no shape.
        far: share of the frames in which a marker is far from its usual place.
    """

    fit: JointFit
    angles: Floats
    lack: str
    frame: int
    far: float

    @property
    def error(self) -> float:
        """Largest standard error of the centre, metres; infinite if it is not known."""
        covariance = self.fit.covariance
        return largest_error(covariance, None) if np.isfinite(covariance).all() else np.inf

    @property
    def ok(self) -> bool:
        """True if the joint moved, its fit is ok, and its standard error is below a centimetre in each direction."""
        return not self.doubt

    @property
    def doubt(self) -> str:
        """Reason why the joint is not ok, in words; empty if it is."""
        if self.lack or self.fit.own_status != Status.OK:
            return self.lack or self.fit.own_status.text
        reasons = []
        if not self.error < CENTIMETRE:
            few = not np.isfinite(self.error)
            reasons.append("too few frames to know its error" if few else "its error is above 1 cm")
        if not self.angles[0] > _MOVED:
            reasons.append("it moved by less than 2° about some direction")
        if self.far > _SOME:
            reasons.append(
                f"in {self.far:.1%} of the frames a marker is out of place: labels exchanged, or a marker knocked"
            )
        return " and ".join(reasons)

    def data(self) -> dict[str, object]:
        """The answer for other programs; metres and degrees, None for what is not known."""
        center, error = self.fit.center, self.error
        return {
            "ok": self.ok,
            "doubt": self.doubt,
            "center": center.tolist() if np.isfinite(center).all() else None,
            "error": error if np.isfinite(error) else None,
            "noise": float(self.fit.sigma) if np.isfinite(self.fit.sigma) else None,
            "moved": np.degrees(self.angles).tolist(),
            "samples": int(self.fit.count.sum()),
            "axes_frame": self.frame or None,
        }

    @property
    def words(self) -> str:
        """The answer in words, in millimetres and degrees."""
        if not np.isfinite(self.fit.center).all():
            return self.doubt
        place = ", ".join(f"{1000 * x:.1f}" for x in self.fit.center)
        moved = "-".join(f"{np.degrees(angle):.0f}°" for angle in self.angles[[0, 2]])
        verdict = "ok" if self.ok else f"unsure: {self.doubt}" if self.fit.own_status == Status.OK else self.doubt
        noise = f"noise {1000 * self.fit.sigma:.1f} mm; moved {moved}"
        where = f"({place}) ± {1000 * self.error:.1f} mm in the parent's axes of frame {self.frame}"
        return f"{where}; {noise}; {int(self.fit.count.sum())} samples; {verdict}"


class LiveJoints:
    """All joints of a stream.

    Args:
        joints: name, markers of the parent and markers of the child of each; letters may be small or capital, as for
            `study joint`.

    Attributes:
        frames: number of frames so far.
        joints: by name, in the given order.
        labels: those that came, the first few hundred of them.
        lacking: those of the joints that have not come.
        zeros: those of the joints that came at exactly (0, 0, 0), which is a gap.
    """

    def __init__(self, joints: Sequence[tuple[str, Sequence[str], Sequence[str]]]) -> None:
        markers = dict.fromkeys(label for _, parent, child in joints for label in (*parent, *child))
        self._rows = {marker: row for row, marker in enumerate(markers)}
        self._markers = {marker.casefold(): marker for marker in markers} | {m: m for m in markers}
        self._segments = {tuple(parent): GrowingSegment([self._rows[m] for m in parent]) for _, parent, _ in joints}
        growing = ((name, self._segments[tuple(parent)], child) for name, parent, child in joints)
        self.joints = {name: GrowingJoint(segment, [self._rows[m] for m in child]) for name, segment, child in growing}
        self.frames = 0
        self.labels: dict[str, None] = {}
        self.lacking: dict[str, None] = markers
        self.zeros: dict[str, None] = {}
        self._spelt: dict[str, str] = {}
        self._waiting: list[Floats] = []

    def add(self, frame: Mapping[str, Floats]) -> None:
        """Add a frame: the place of each marker seen (3,), metres."""
        self.frames += 1
        if len(self.labels) < _LABELS:
            self.labels |= dict.fromkeys(frame)
        x = np.full((len(self._rows), 3), np.nan)
        for label, place in frame.items():
            marker = self._markers.get(label) or self._markers.get(label.casefold())
            if marker == label:
                self._spelt[marker] = label
            # a stream may have labels that differ in case alone
            if marker is None or self._spelt.setdefault(marker, label) != label:
                continue
            if place.any():
                x[self._rows[marker]] = place
                self.lacking.pop(marker, None)
            else:
                self.zeros[marker] = None
        self._waiting.append(x)
        if len(self._waiting) == _BATCH:
            self._settle()

    @property
    def jumps(self) -> int:
        """Number of samples and of poses that were left out, because a marker jumped."""
        segments, joints = self._segments.values(), self.joints.values()
        return sum(segment.jumps for segment in segments) + sum(joint.jumps for joint in joints)

    def answers(self) -> dict[str, LiveAnswer]:
        """Each joint as far as it is known."""
        self._settle()
        return {name: joint.answer() for name, joint in self.joints.items()}

    def data(self) -> list[dict[str, object]]:
        """The answers for other programs: each joint's own, its name, the number of frames, and its parent's shape.

        ``parent_markers`` has the place of each of the parent's markers in its axes, metres; ``axes_frame`` is the
        frame in which these are the stream's. Both are None as long as the parent has no shape.
        """
        names, rows = list(self._rows), []
        for name, answer in self.answers().items():
            parent = self.joints[name].parent
            known = parent.template is not None
            shape = {} if parent.template is None else dict(zip(parent.rows, parent.template.tolist(), strict=True))
            row = {"frame": self.frames, "joint": name} | answer.data()
            rows.append(row | {"parent_markers": {names[k]: place for k, place in shape.items()} if known else None})
        return rows

    def _settle(self) -> None:
        """Add the frames that wait."""
        if not self._waiting:
            return
        x = np.stack(self._waiting, axis=2)
        self._waiting = []
        poses = {segment: segment.poses(x[segment.rows]) for segment in self._segments.values()}
        for joint in self.joints.values():
            joint.add(to_local(*poses[joint.parent], x[joint.rows]))


def median(x: Floats) -> Floats:
    """Median along the last axis of the numbers that are there (the upper of two); NaN where none is."""
    count = np.sum(~np.isnan(x), axis=-1, keepdims=True)
    place = np.minimum(count // 2, x.shape[-1] - 1)
    return np.take_along_axis(np.sort(x, axis=-1), place, axis=-1)[..., 0]


def merged(blocks: Sequence[Sequence[Incremental]]) -> list[Incremental]:
    """The moments of each marker (M) over several blocks."""
    total = [Incremental(3) for _ in blocks[0]]
    for block in blocks:
        for mine, part in zip(total, block, strict=True):
            mine.merge(part)
    return total


def rms_angles(markers: Sequence[Incremental], fit: JointFit) -> Floats:
    """Root mean square angles of the markers' motion about a centre, along principal directions (3,), ascending.

    They are 0 where they are not known.
    """
    total, count = np.zeros((3, 3)), 0.0
    for marker, radius in zip(markers, fit.radii, strict=True):
        if marker.moments is not None and radius > 0.0:
            n = float(marker.moments.n[0])
            total += (marker.moments.second[0] - n * fit.noise_variance * np.eye(3)) / radius**2
            count += n
    if not np.isfinite(total).all():  # so few points that their noise is not known
        return np.zeros(3)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(total / max(count, 1.0)), 0.0)))
