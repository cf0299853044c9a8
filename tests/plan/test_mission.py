"""Missions: what ground stations read of them, what a pilot reads, and what cannot be flown."""

import json
import math
from pathlib import Path

import pytest
from pymavlink import mavutil, mavwp

from shockrig.analysis.plan.flight_plan import Hover, OutAndBack, Straight, minutes, mission_of, words
from shockrig.files.errors import InputError
from shockrig.files.mission import write_mission

HOME = (46.8130, 6.9430, 491.0)
LEGS = (Straight(110.0, 2.0), Hover(60.0), OutAndBack(400.0, 8.0), Straight(60.0, 4.0), Straight(20.0, 4.0))


def metres(place: tuple[float, float]) -> tuple[float, float]:
    """North and east of home."""
    metre = 6_371_000.0 * math.pi / 180.0
    return (place[0] - HOME[0]) * metre, (place[1] - HOME[1]) * metre * math.cos(math.radians(HOME[0]))


def test_pymavlink_reads_the_waypoints(tmp_path):
    write_mission(tmp_path / "flight.waypoints", mission_of(HOME, LEGS))
    loader = mavwp.MAVWPLoader()
    count = loader.load(str(tmp_path / "flight.waypoints"))
    read = [loader.wp(k) for k in range(count)]
    home = read[0]
    assert (home.command, home.frame) == (16, 0) and (home.x, home.y, home.z) == pytest.approx(HOME)
    names = [mavutil.mavlink.enums["MAV_CMD"][one.command].name for one in read[1:]]
    assert names == [
        "MAV_CMD_NAV_TAKEOFF",
        "MAV_CMD_DO_CHANGE_SPEED",
        "MAV_CMD_NAV_WAYPOINT",
        "MAV_CMD_NAV_LOITER_TIME",
        "MAV_CMD_DO_CHANGE_SPEED",
        "MAV_CMD_NAV_WAYPOINT",
        "MAV_CMD_NAV_WAYPOINT",
        "MAV_CMD_DO_CHANGE_SPEED",
        "MAV_CMD_NAV_WAYPOINT",
        "MAV_CMD_NAV_WAYPOINT",
        "MAV_CMD_NAV_RETURN_TO_LAUNCH",
    ]
    speeds = [(one.param1, one.param2) for one in read if one.command == 178]
    kind = mavutil.mavlink
    types = (kind.SPEED_TYPE_CLIMB_SPEED, kind.SPEED_TYPE_GROUNDSPEED, kind.SPEED_TYPE_DESCENT_SPEED)
    assert speeds == list(zip(types, (2.0, 8.0, 4.0), strict=True))
    placed = [one for one in read[1:] if one.command in {16, 19, 22}]
    assert {one.frame for one in placed} == {mavutil.mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT}
    assert next(one.param1 for one in read if one.command == 19) == 60.0
    out = metres((read[6].x, read[6].y))
    assert out == pytest.approx((200.0, 0.0), abs=0.05) and read[6].z == 110.0


def test_a_plan_is_as_qgroundcontrol_publishes_it(tmp_path):
    """Keys and types of its developer guide's plan format, and the same items as the .waypoints."""
    write_mission(tmp_path / "flight.plan", mission_of(HOME, LEGS))
    content = json.loads((tmp_path / "flight.plan").read_text())
    assert (content["fileType"], content["version"], content["groundStation"]) == ("Plan", 1, "QGroundControl")
    assert content["geoFence"] == {"circles": [], "polygons": [], "version": 2}
    assert content["rallyPoints"] == {"points": [], "version": 2}
    mission = content["mission"]
    assert mission["version"] == 2 and mission["plannedHomePosition"] == list(HOME)
    assert mission["firmwareType"] == mavutil.mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert mission["vehicleType"] == mavutil.mavlink.MAV_TYPE_QUADROTOR
    assert {"cruiseSpeed", "hoverSpeed", "globalPlanAltitudeMode"} <= mission.keys()
    write_mission(tmp_path / "flight.waypoints", mission_of(HOME, LEGS))
    lines = (tmp_path / "flight.waypoints").read_text().splitlines()[2:]
    assert len(mission["items"]) == len(lines)
    for number, (item, line) in enumerate(zip(mission["items"], lines, strict=True), start=1):
        cells = line.split("\t")
        assert item["type"] == "SimpleItem" and item["autoContinue"] is True and item["doJumpId"] == number
        assert [item["frame"], item["command"]] == [int(cells[2]), int(cells[3])]
        assert item["params"] == pytest.approx([float(cell) for cell in cells[4:11]], abs=0.006)
        assert ("Altitude" in item) == (item["frame"] == 3)


def test_a_pilot_reads_a_sentence_a_leg_and_the_minutes():
    said = words(LEGS)
    assert said[0] == "Take off and rise to 10 m above home."
    assert said[1] == "Climb straight up from 10 to 110 m at 2 m/s (0.8 min)."
    assert said[2] == "Hover at 110 m for 60 s."
    assert said[3] == "Fly level at 110 m, 200 m out towards north and back, at 8 m/s over the ground (0.8 min)."
    assert said[4] == "Descend straight down from 110 to 60 m at 4 m/s (0.2 min)."
    assert said[-2:] == ["Return to launch and land.", f"The flight takes {minutes(LEGS):.1f} minutes."]
    assert len(said) == 1 + len(LEGS) + 2
    whole = 10 / 2.5 + 50 + 60 + 50 + 12.5 + 10 + 10 / 1.5 + 10 / 0.5
    assert minutes(LEGS) * 60.0 == pytest.approx(whole, abs=2.0)


def test_a_mission_of_a_wrong_name_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"\.waypoints"):
        write_mission(Path("flight.txt"), mission_of(HOME, LEGS))
    with pytest.raises(InputError, match="folder that can be written"):
        write_mission(tmp_path / "none" / "flight.plan", mission_of(HOME, LEGS))
