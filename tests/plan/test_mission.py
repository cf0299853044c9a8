"""Missions: what ground stations read of them, what a pilot reads, and what cannot be flown."""

import json
import math
from pathlib import Path

import pytest
from pymavlink import mavutil, mavwp

from shockrig.analysis.plan.flight_plan import (
    Climb,
    Descend,
    FlightPlan,
    Hover,
    OutAndBack,
    Spiral,
    Turn,
    minutes,
    mission_of,
    words,
)
from shockrig.files.errors import InputError
from shockrig.files.mission import write_mission

HOME = (46.8130, 6.9430, 491.0)
LEGS = (
    Climb(110.0, 2.0),
    Hover(110.0, 60.0),
    OutAndBack(400.0, 8.0),
    Turn(2, 50.0, 8.0),
    Descend(60.0, 4.0),
    Spiral(20.0, 1.0, 30.0, 6.0),
)
PLAN = FlightPlan(HOME, LEGS, heading_deg=90.0)


def metres(place: tuple[float, float]) -> tuple[float, float]:
    """North and east of home."""
    metre = 6_371_000.0 * math.pi / 180.0
    return (place[0] - HOME[0]) * metre, (place[1] - HOME[1]) * metre * math.cos(math.radians(HOME[0]))


def test_pymavlink_reads_the_waypoints(tmp_path):
    write_mission(tmp_path / "flight.waypoints", mission_of(PLAN))
    loader = mavwp.MAVWPLoader()
    count = loader.load(str(tmp_path / "flight.waypoints"))
    read = [loader.wp(k) for k in range(count)]
    home = read[0]
    assert (home.command, home.frame) == (16, 0) and (home.x, home.y, home.z) == pytest.approx(HOME)
    names = [mavutil.mavlink.enums["MAV_CMD"][one.command].name for one in read[1:]]
    assert names[:8] == [
        "MAV_CMD_NAV_TAKEOFF",
        "MAV_CMD_DO_CHANGE_SPEED",
        "MAV_CMD_NAV_WAYPOINT",
        "MAV_CMD_NAV_LOITER_TIME",
        "MAV_CMD_DO_CHANGE_SPEED",
        "MAV_CMD_NAV_WAYPOINT",
        "MAV_CMD_NAV_WAYPOINT",
        "MAV_CMD_NAV_WAYPOINT",
    ]
    assert names[-1] == "MAV_CMD_NAV_RETURN_TO_LAUNCH"
    speeds = [(one.param1, one.param2) for one in read if one.command == 178]
    kind = mavutil.mavlink
    assert speeds[:3] == [(kind.SPEED_TYPE_CLIMB_SPEED, 2.0), (kind.SPEED_TYPE_GROUNDSPEED, 8.0), (3.0, 4.0)]
    assert speeds[4] == (kind.SPEED_TYPE_DESCENT_SPEED, 1.0)
    placed = [one for one in read[1:] if one.command in {16, 19, 22}]
    assert {one.frame for one in placed} == {mavutil.mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT}
    assert next(one.param1 for one in read if one.command == 19) == 60.0
    out = metres((read[6].x, read[6].y))
    assert out == pytest.approx((0.0, 200.0), abs=0.05) and read[6].z == 110.0


def test_a_plan_is_as_qgroundcontrol_publishes_it(tmp_path):
    """Keys and types of its developer guide's plan format, and the same items as the .waypoints."""
    write_mission(tmp_path / "flight.plan", mission_of(PLAN))
    content = json.loads((tmp_path / "flight.plan").read_text())
    assert (content["fileType"], content["version"], content["groundStation"]) == ("Plan", 1, "QGroundControl")
    assert content["geoFence"] == {"circles": [], "polygons": [], "version": 2}
    assert content["rallyPoints"] == {"points": [], "version": 2}
    mission = content["mission"]
    assert mission["version"] == 2 and mission["plannedHomePosition"] == list(HOME)
    assert mission["firmwareType"] == mavutil.mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert mission["vehicleType"] == mavutil.mavlink.MAV_TYPE_QUADROTOR
    assert {"cruiseSpeed", "hoverSpeed", "globalPlanAltitudeMode"} <= mission.keys()
    write_mission(tmp_path / "flight.waypoints", mission_of(PLAN))
    lines = (tmp_path / "flight.waypoints").read_text().splitlines()[2:]
    assert len(mission["items"]) == len(lines)
    for number, (item, line) in enumerate(zip(mission["items"], lines, strict=True), start=1):
        cells = line.split("\t")
        assert item["type"] == "SimpleItem" and item["autoContinue"] is True and item["doJumpId"] == number
        assert [item["frame"], item["command"]] == [int(cells[2]), int(cells[3])]
        assert item["params"] == pytest.approx([float(cell) for cell in cells[4:11]], abs=0.006)
        assert ("Altitude" in item) == (item["frame"] == 3)


def test_a_spiral_goes_down_evenly_on_its_circle_and_ends_at_home():
    spiral = [item for item in mission_of(PLAN).items if item.command == 16][-12:]
    heights = [item.position[2] for item in spiral]
    away = [metres(item.position[:2]) for item in spiral]
    assert heights == pytest.approx([60.0 - 40.0 * k / 12 for k in range(1, 13)])
    assert [math.hypot(n, e - 30.0) for n, e in away] == pytest.approx([30.0] * 12, abs=0.01)
    assert away[-1] == pytest.approx((0.0, 0.0), abs=0.01)
    # on one circle in the 40 s that 40 m at 1 m/s take
    horizontal = [item.params[1] for item in mission_of(PLAN).items if item.command == 178 and item.params[0] == 1.0]
    assert horizontal[-1] == pytest.approx(2 * math.pi * 30.0 / 40.0, rel=0.02)


def test_a_pilot_reads_a_sentence_a_leg_and_the_minutes():
    said = words(PLAN)
    assert said[0] == "Take off and rise to 10 m above home."
    assert said[1] == "Climb straight up from 10 to 110 m at 2 m/s (0.8 min)."
    assert said[2] == "Hover at 110 m for 60 s."
    assert said[3] == "Fly level at 110 m, 200 m out towards 90° and back, at 8 m/s over the ground (0.8 min)."
    assert said[6].startswith("Spiral down from 60 to 20 m at 1 m/s in one circle of 30 m radius, at 4.7 m/s")
    assert said[-2:] == ["Return to launch and land.", f"The flight takes {minutes(PLAN):.1f} minutes."]
    assert len(said) == 1 + len(LEGS) + 2
    circles = 2 * 2 * math.pi * 50.0 / 8.0
    whole = 10 / 2.5 + 50 + 60 + 50 + circles + 12.5 + 40 + 10 / 1.5 + 10 / 0.5
    assert minutes(PLAN) * 60.0 == pytest.approx(whole, abs=2.0)


@pytest.mark.parametrize(
    ("legs", "settings", "said"),
    [
        ((), {}, "without legs"),
        ((Climb(100.0, 36.0),), {}, r"leg 1: speed_m_s 36 cannot be; expected 0.1 to 10 \(is it in km/h\?\)"),
        ((Climb(100.0, 3.0), Descend(20.0, 6.0)), {}, "leg 2: speed_m_s 6"),
        ((Climb(1000.0, 3.0),), {}, "leg 1: 1000 m above home; expected 2 m to the ceiling of 120 m"),
        ((Climb(100.0, 3.0), Hover(50.0, 30.0)), {}, "a hover at 50 m, and the drone is at 100 m"),
        ((Climb(100.0, 3.0), Descend(110.0, 3.0)), {}, "leg 2: a descent to 110 m, and the drone is at 100 m"),
        ((Descend(5.0, 1.0), Climb(5.0, 1.0)), {}, "leg 2: a climb to 5 m"),
        ((Hover(10.0, math.nan),), {}, "seconds nan"),
        ((Turn(1.5, 50.0, 5.0),), {}, "1.5 turns"),
        ((Turn(math.nan, 50.0, 5.0),), {}, "turns nan"),
        ((Spiral(math.inf, 5.0, 50.0, 5.0),), {"ceiling_m": math.inf}, "ceiling_m inf"),
        ((Spiral(100.0, 5.0, 1000.0, 5.0),), {}, "airspeed_m_s on whole circles"),
        ((Hover(10.0, 1800.0),), {"endurance_minutes": 20.0}, "takes 30.4 minutes and the drone flies 20"),
        ((Turn(50, 5.0, 5.0), Turn(50, 5.0, 5.0)), {}, "mission items"),
        ((Hover(10.0, 60.0),), {"home": (95.0, 7.0, 0.0)}, "home: latitude 95"),
        ((Hover(10.0, 60.0),), {"end": "crash"}, "'return' or 'land'"),
    ],
)
def test_what_cannot_be_flown_is_refused(legs, settings, said):
    with pytest.raises(InputError, match=said):
        FlightPlan(**{"home": HOME, "legs": legs, **settings})


def test_a_mission_lands_where_it_is_and_a_wrong_name_is_refused(tmp_path):
    plan = FlightPlan(HOME, (Hover(10.0, 30.0),), end="land")
    assert mission_of(plan).items[-1].command == 21 and words(plan)[-2] == "Land."
    with pytest.raises(InputError, match=r"\.waypoints"):
        write_mission(Path("flight.txt"), mission_of(plan))
    with pytest.raises(InputError, match="folder that can be written"):
        write_mission(tmp_path / "none" / "flight.plan", mission_of(plan))
