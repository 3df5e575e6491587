"""Conversion of palm poses in a named frame to positions on the scene's axes."""

import math
from collections.abc import Sequence

import numpy as np

from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.quantity import LARGEST_NUMBER
from tactile_localizer.scene import Axis


class PalmFrame:
    """Transforms palm poses into the material's frame.

    Parameters
    ----------
    axes : the d axes of the positions
    material_frame : name of the material's frame
    reference_frame : another frame in which poses may be given, such as the robot's base; empty: none
    material_pose : x, y, z (m), roll, pitch, yaw (rad) of the material in ``reference_frame``

    Raises
    ------
    ParameterError
        ``material_pose`` is not six finite numbers.
    """

    def __init__(
        self,
        axes: tuple[Axis, ...],
        material_frame: str = "material",
        reference_frame: str = "",
        material_pose: Sequence[float] = (0.0,) * 6,
    ) -> None:
        if len(material_pose) != 6 or not all(map(math.isfinite, material_pose)):
            raise ParameterError(
                f"material_pose: expected x, y, z, roll, pitch, yaw, got {list(material_pose)}"
            )
        self.material_frame, self.reference_frame = material_frame, reference_frame
        self.dimension = len(axes)
        self._names = tuple(axis.name for axis in axes)
        self._from = {material_frame: (np.eye(3).tolist(), [0.0] * 3)}
        if reference_frame and reference_frame != material_frame:
            rotation = np.eye(3)
            if any(material_pose[3:]):
                from scipy.spatial.transform import Rotation  # takes a while, and many materials lie flat

                rotation = Rotation.from_euler("xyz", material_pose[3:]).as_matrix().T
            offset = -rotation @ np.asarray(material_pose[:3])
            self._from[reference_frame] = (rotation.tolist(), offset.tolist())

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames in which poses may be given."""
        return tuple(self._from)

    def position(self, frame: str, translation: Sequence[float], quaternion: Sequence[float]) -> np.ndarray:
        """The palm's position on the axes, (d,), m (yaw: rad).

        Parameters
        ----------
        frame : frame of the pose
        translation : x, y, z, m
        quaternion : x, y, z, w

        Raises
        ------
        MeasurementError
            The frame is unknown, or the pose is not finite or beyond :data:`~.quantity.LARGEST_NUMBER`.
        """
        position = self._on_axes(frame, *translation, *quaternion)
        if not all(abs(each) <= LARGEST_NUMBER for each in position):
            raise MeasurementError(f"palm pose: expected finite {', '.join(self._names)}, got {position}")
        return np.array(position)

    def _on_axes(self, frame: str, x: float, y: float, z: float, *quaternion: float) -> list[float]:
        """Coordinates of a pose, one for each axis."""
        if frame not in self._from:
            known = " or ".join(repr(name) for name in self._from)
            raise MeasurementError(f"palm pose frame {frame!r}: expected {known}")
        rows, offset = self._from[frame]
        values = {
            name: row[0] * x + row[1] * y + row[2] * z + start
            for name, row, start in zip("xy", rows, offset, strict=False)
        }
        if "yaw" in self._names:
            values["yaw"] = _yaw(rows, *quaternion)
        return [values[name] for name in self._names]


def _yaw(rows: list[list[float]], x: float, y: float, z: float, w: float) -> float:
    """Heading of the palm's x axis in the material's x-y plane; NaN for a quaternion of length zero."""
    # The palm's x axis in the given frame, times the quaternion's squared length.
    along, across, up = w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)
    heading = [row[0] * along + row[1] * across + row[2] * up for row in rows]
    return math.atan2(heading[1], heading[0]) if any((x, y, z, w)) else math.nan
