"""Where the lidar of a bag sits on the robot: from its transforms, or as the user states it."""

from __future__ import annotations

from dataclasses import dataclass

from wherry.errors import InputError
from wherry.logs.options import LIDAR_HINT
from wherry.logs.rejections import Rejections
from wherry.ros.bags.recorded_transforms import RecordedTransforms, TransformTable
from wherry.ros.frame_names import is_base_frame, is_odometry_frame, is_world_frame, listed_frames, resolve_frame, shown
from wherry.ros.transforms import Mount, MountError
from wherry.space.pose import Pose, wrap

STATED_PLACE = "--lidar x,y,theta states where the lidar sits (m, m, degrees)"
MAX_STATED_DISTANCE, MAX_STATED_ANGLE = 0.02, 0.02  # m, rad, between the pose stated and that of the transforms


@dataclass(frozen=True, slots=True)
class RobotFrames:
    """Frames of the robot, as scans and odometry name them.

    Attributes:
        laser: Frame of the scans.
        base: Frame whose pose odometry gives; empty if it is not named.
        odom: Frame of odometry; empty if it is not named.
        has_odometry: Whether the bag has odometry.
        namespace: First component of the scan topic's namespace; empty if it has none.
        has_other_scans: Whether the bag has other topics of scans.
    """

    laser: str
    base: str
    odom: str
    has_odometry: bool
    namespace: str = ""
    has_other_scans: bool = False

    @property
    def prefix(self) -> str:
        """Prefix of the robot's frames: that of a frame's name, otherwise the namespace."""
        prefixes = (name.rpartition("/")[0] for name in (self.base, self.odom, self.laser))
        return next(filter(None, prefixes), self.namespace)

    def is_world(self, frame: str) -> bool:
        """Whether the robot moves in a frame."""
        return is_world_frame(frame) or (frame == self.odom and not is_base_frame(frame))


class MountFinder:
    """Finds the lidar's mount.

    Args:
        transforms: Transforms of the bag.
        frames: Frames of the robot.
        rejections: Takes unusable transforms between the robot and the lidar.
        notes: Takes what was decided, as sentences.
    """

    def __init__(
        self, transforms: RecordedTransforms, frames: RobotFrames, rejections: Rejections, notes: list[str]
    ) -> None:
        self._transforms = transforms
        self.frames, self.rejections, self.notes = frames, rejections, notes

    def find(self) -> Mount | None:
        """The mount by the transforms; None if they do not tell it.

        Raises:
            InputError: A transform between the robot and the lidar cannot be used, moves, or tilts the lidar.
        """
        frames = self.frames
        if frames.laser and frames.laser == frames.base:
            return Mount()
        names_base = bool(frames.base) or not frames.has_odometry
        attempts = [(True, self._bases), (False, self._bases), (False, self._equivalent_bases)]
        for static_only, bases in attempts if names_base else attempts[1:]:
            for table in self._transforms.tables(frames.prefix, static_only=static_only):
                mount = self._mount_in(table, bases(table))
                if mount is not None:
                    return mount
        return None

    def stated(self, pose: Pose, found: Mount | None) -> Mount:
        """The mount that the user states; a note says if that of the transforms differs."""
        mount = Mount(pose)
        if found is not None:
            is_near = found.pose.distance_to(pose) <= MAX_STATED_DISTANCE
            is_near = is_near and abs(wrap(found.pose.theta - pose.theta)) <= MAX_STATED_ANGLE
            if found.is_upside_down or not is_near:
                self.notes.append(f"the lidar is at {mount} as --lidar states; the transforms have it at {found}")
        return mount

    def unusable_transform(self) -> InputError | None:
        """The error about an unusable transform without which the mount is unknown; None if there is none."""
        frames = self.frames
        *_, table = self._transforms.tables(frames.prefix, static_only=False)
        tree = table.tree
        laser = resolve_frame(frames.laser, tree.all_frames, frames.prefix) or frames.laser
        for named in [frames.base] if frames.base else filter(is_base_frame, sorted(tree.all_frames)):
            base = resolve_frame(named, tree.all_frames, frames.prefix) or named
            for name, reason in tree.rejected_between(base, laser, frames.is_world):
                return InputError(self.rejections.source, name, f"{reason}; {STATED_PLACE}")
        return None

    def unknown(self) -> InputError:
        """The error that says what is missing to know the mount."""
        frames = self.frames
        *_, table = self._transforms.tables(frames.prefix, static_only=False)
        known = listed_frames(frame for frame in table.tree.frames if not frames.is_world(frame))
        base = shown(frames.base or "base_link")
        reason = f"where the lidar sits on {base} is unknown; {self._options}; frames of the transforms: {known}"
        return InputError(self.rejections.source, f"frame {shown(frames.laser)!r}", reason)

    @property
    def _options(self) -> str:
        """The options that help where the transforms do not, for errors."""
        return f"{LIDAR_HINT}{', --scan-topic chooses other scans' * self.frames.has_other_scans}"

    def _mount_in(self, table: TransformTable, bases: list[str]) -> Mount | None:
        """The mount by one table of transforms."""
        frames = self.frames
        laser = resolve_frame(frames.laser, table.tree.frames | set(bases), frames.prefix) or frames.laser
        for base in bases:
            try:
                transform = table.tree.lookup(base, laser, frames.is_world)
                if transform is not None:
                    self._report(table, base, laser)
                    return Mount.from_transform(transform)
            except MountError as error:
                reason = f"where the lidar sits on {shown(base)} cannot be used: {error}; {self._options}"
                raise InputError(self.rejections.source, f"frame {shown(frames.laser)!r}", reason) from error
        return None

    def _report(self, table: TransformTable, base: str, laser: str) -> None:
        """Reject the unusable transforms on the way from the base frame to the lidar, and note frames taken for others.

        Raises:
            InputError: There are unusable ones, and the reader is not lenient.
        """
        for name, reason in table.tree.rejected_between(base, laser, self.frames.is_world):
            self.rejections.reject(name, reason)
        for found, named in ((laser, self.frames.laser), (base, self.frames.base)):
            if named and found != named:
                self.notes.append(
                    f"the frame {shown(named)!r} of the messages is taken for {shown(found)!r} of the transforms"
                )
        if self.frames.has_odometry and not self.frames.base:
            self.notes.append(f"odometry does not name the robot's frame; {shown(base)!r} is taken for it")

    def _bases(self, table: TransformTable) -> list[str]:
        """Candidates for the base frame: that of odometry; without its name, what the transforms have in odom."""
        frames, known = self.frames, table.tree.frames
        if frames.base:
            found = resolve_frame(frames.base, known | {frames.laser}, frames.prefix)
            return [] if found is None else [found]
        children = [child for parent, child in table.counts if is_odometry_frame(parent) and not frames.is_world(child)]
        return [*self._of_robot(children), *self._base_names(table)]

    def _base_names(self, table: TransformTable) -> list[str]:
        """Frames with the name of a base frame, base_link first; those without a prefix first."""
        known = {frame for frame in table.tree.frames | {self.frames.laser} if is_base_frame(frame)}
        return self._of_robot(sorted(known, key=lambda frame: (len(frame), not frame.endswith("base_link"), frame)))

    def _of_robot(self, frames: list[str]) -> list[str]:
        """Frames with the robot's prefix, if any has it; otherwise all."""
        prefix = f"{self.frames.prefix}/"
        own = [frame for frame in frames if frame.startswith(prefix)]
        return own or frames

    def _equivalent_bases(self, table: TransformTable) -> list[str]:
        """base_link for base_footprint and the reverse, which differ only in their height in REP 120."""
        return self._base_names(table) if is_base_frame(self.frames.base) else []
