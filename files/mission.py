"""A mission as ground stations open it: MAVLink commands in a `.waypoints` file (QGC WPL 110) or a `.plan` file.

`.waypoints` holds a line for each command, home first, its fields apart by tabs (mavlink.io/en/file_formats); `.plan`
is QGroundControl's JSON (QGroundControl's developer guide, "Plan File Format").
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

from shockrig.files.disk import shown, write_whole
from shockrig.files.errors import InputError
from shockrig.files.json_files import write_json


class Command(IntEnum):
    """MAV_CMD: what the drone does in one item."""

    WAYPOINT = 16
    LOITER_TIME = 19
    RETURN_TO_LAUNCH = 20
    TAKEOFF = 22
    CHANGE_SPEED = 178


class Speed(IntEnum):
    """SPEED_TYPE: which speed `CHANGE_SPEED` sets."""

    GROUND = 1
    CLIMB = 2
    DESCENT = 3


class Frame(IntEnum):
    """MAV_FRAME: what a position of an item is measured from."""

    GLOBAL = 0
    MISSION = 2  # no position
    ABOVE_HOME = 3


ARDUPILOT, QUADROTOR = 3, 2  # MAV_AUTOPILOT, MAV_TYPE
RELATIVE_MODE = 1  # QGroundControl's altitude mode of altitudes above home


@dataclass(frozen=True)
class Item:
    """One command: `params` are its own four numbers, `position` is latitude [deg], longitude [deg] and altitude above
    home [m]."""

    command: Command
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    position: tuple[float, float, float] | None = None

    @property
    def frame(self) -> Frame:
        return Frame.MISSION if self.position is None else Frame.ABOVE_HOME

    @property
    def numbers(self) -> tuple[float, ...]:
        """All seven, as MISSION_ITEM has them."""
        return (*self.params, *(self.position or (0.0, 0.0, 0.0)))


@dataclass(frozen=True)
class Mission:
    """Commands from takeoff to landing.

    Attributes
    ----------
    home : tuple
        Latitude [deg], longitude [deg], altitude above the sea [m].
    items : tuple of Item
    horizontal_m_s : float
        Speed between waypoints until an item changes it; of `.plan`, which shows times with it.
    """

    home: tuple[float, float, float]
    items: tuple[Item, ...]
    horizontal_m_s: float


def write_mission(path: Path, mission: Mission) -> None:
    """Write a mission, whole or not at all, in the form that the file's name ends in.

    Raises
    ------
    InputError
        The name ends in neither `.waypoints` nor `.plan`, or the file cannot be written.
    """
    try:
        if path.suffix == ".waypoints":
            write_whole(path, waypoints_text(mission))
        elif path.suffix == ".plan":
            write_json(path, plan_document(mission))
        else:
            raise InputError(f"{shown(path)}: a mission's name ends in .waypoints or .plan; name it so")
    except OSError as error:
        raise InputError(
            f"{shown(path)}: {error.strerror or error}; name a file in a folder that can be written"
        ) from None


def waypoints_text(mission: Mission) -> str:
    """The text of a `.waypoints` file."""
    home = (Frame.GLOBAL, Command.WAYPOINT, (0.0, 0.0, 0.0, 0.0, *mission.home))
    lines = ["QGC WPL 110"]
    for index, (frame, command, numbers) in enumerate(
        [home, *((item.frame, item.command, item.numbers) for item in mission.items)]
    ):
        own, (latitude, longitude, altitude) = numbers[:4], numbers[4:]
        cells = [*(f"{one:g}" for one in own), f"{latitude:.7f}", f"{longitude:.7f}", f"{altitude:.2f}"]
        # the second is 1 for the item that is flown first, the last for one that is followed by the next by itself
        lines.append("\t".join([str(index), str(int(index == 0)), str(int(frame)), str(int(command)), *cells, "1"]))
    return "\n".join(lines) + "\n"


def plan_document(mission: Mission) -> dict[str, Any]:
    """The content of a `.plan` file."""
    items = []
    for number, item in enumerate(mission.items, start=1):
        content: dict[str, Any] = {
            "autoContinue": True,
            "command": int(item.command),
            "doJumpId": number,
            "frame": int(item.frame),
            "params": list(item.numbers),
            "type": "SimpleItem",
        }
        if item.position is not None:
            content |= {"AMSLAltAboveTerrain": None, "Altitude": item.position[2], "AltitudeMode": RELATIVE_MODE}
        items.append(content)
    return {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": mission.horizontal_m_s,
            "firmwareType": ARDUPILOT,
            "globalPlanAltitudeMode": RELATIVE_MODE,
            "hoverSpeed": mission.horizontal_m_s,
            "items": items,
            "plannedHomePosition": list(mission.home),
            "vehicleType": QUADROTOR,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }
