"""A hundred thousand messages of DroneCAN and of MAVLink, read by python-dronecan and by pymavlink's own listener.

    python benchmarks/messages.py [MESSAGES]

Each goes through a socket (UDP multicast, UDP) into the library that ground stations use, and is compared with what was
said: equal to it rounded to the message's type, in its unit, under its stamp.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np

os.environ["MAVLINK20"] = "1"  # read when pymavlink is imported

from shockrig.rig.links.dronecan import DronecanNode, this_machine
from shockrig.rig.links.mavlink import MavlinkEnd, MavlinkSpeaker
from shockrig.rig.links.ports import UdpPort, open_frames
from shockrig.rig.links.said import SaidAir

HERE, PORT, BUS = "127.0.0.1", 14_561, 77
PER_SAID = {"dronecan": 4, "mavlink": 8}
AHEAD = 20  # airs that may be under way: more than a socket holds would be lost


def airs(count: int) -> Iterator[SaidAir]:
    """Airs from the coldest to the hottest that fly, a row every 0.1 s; stamps of a week."""
    rng = np.random.default_rng(32)
    for k in range(count):
        t, h = rng.uniform(-80.0, 60.0), rng.uniform(0.0, 110.0)
        said = tuple(float(v) for v in (t, h, rng.uniform(0.0, 2.0), rng.uniform(0.0, 9.0), t + 0.3, h - 0.5))
        yield SaidAir(604_800.0 * k / count, said[0:2], said[2:4], said[4:6])


def wanted_dronecan(said: SaidAir) -> list[tuple[str, int, float, float]]:
    found = []
    for sensor, (t, h) in enumerate((said.air, said.read or said.air)):
        found.append(("Hygrometer", sensor, float(np.float16(t)), float(np.float16(h))))
        found.append(("Temperature", sensor, float(np.float16(t + 273.15)), 0.0))
    return found


def wanted_mavlink(said: SaidAir) -> list[tuple[str, int, float, float]]:
    found: list[tuple[str, int, float, float]] = []
    for sensor, (t, h) in enumerate((said.air, said.read or said.air)):
        found.append(("HYGROMETER_SENSOR", sensor, round(100 * t), max(round(100 * h), 0)))
    stamp = round(1000 * said.time_s)
    names = ("T_air", "RH_air", "T_unc", "RH_unc", "T_read", "RH_read")
    values = (*said.air, *(said.uncertainty or ()), *(said.read or ()))
    return found + [(name, stamp, float(np.float32(v)), 0.0) for name, v in zip(names, values, strict=True)]


def dronecan_run(count: int) -> tuple[int, int, float]:
    """Messages, those that were not as wanted, seconds."""
    import dronecan

    node = dronecan.make_node(f"mcast:{BUS}", node_id=100)
    node.can_driver  # noqa: B018  (starts the library's own process)
    got: list[tuple[str, int, float, float]] = []
    hygrometer, temperature = dronecan.dronecan.sensors.hygrometer, dronecan.uavcan.equipment.device
    node.add_handler(
        hygrometer.Hygrometer,
        lambda e: got.append(("Hygrometer", e.message.id, e.message.temperature, e.message.humidity)),
    )
    node.add_handler(
        temperature.Temperature,
        lambda e: got.append(("Temperature", e.message.device_id, e.message.temperature, 0.0)),
    )
    time.sleep(1.0)  # its process joins the group
    ours = DronecanNode(open_frames(f"mcast:{BUS}"), 44, this_machine())
    return _compared(ours, airs(count), wanted_dronecan, got, lambda: node.spin(0.001), PER_SAID["dronecan"])


def mavlink_run(count: int) -> tuple[int, int, float]:
    from pymavlink import mavutil  # type: ignore[import-untyped]

    listener = mavutil.mavlink_connection(f"udpin:{HERE}:{PORT}")
    got: list[tuple[str, int, float, float]] = []

    def hear() -> None:
        while (message := listener.recv_match()) is not None:
            if message.get_type() == "HYGROMETER_SENSOR":
                got.append(("HYGROMETER_SENSOR", message.id, message.temperature, message.humidity))
            elif message.get_type() == "NAMED_VALUE_FLOAT":
                got.append((message.name, message.time_boot_ms, message.value, 0.0))

    ours = MavlinkSpeaker(MavlinkEnd(UdpPort(HERE, PORT, False)))
    return _compared(ours, airs(count), wanted_mavlink, got, hear, PER_SAID["mavlink"])


def _compared(ours, said, wanted, got, hear, per_said) -> tuple[int, int, float]:  # type: ignore[no-untyped-def]
    began, expected = time.monotonic(), []
    for air in said:
        ours.send(air)
        expected += wanted(air)
        while len(expected) - len(got) > AHEAD * per_said and time.monotonic() - began < 3600:
            hear()
    late = time.monotonic() + 10
    while len(got) < len(expected) and time.monotonic() < late:
        hear()
    wrong = sum(a != b for a, b in zip(got, expected, strict=False)) + abs(len(got) - len(expected))
    return len(expected), wrong, time.monotonic() - began


def main() -> None:
    messages = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    for name, run in (("mavlink", mavlink_run), ("dronecan", dronecan_run)):
        sent, wrong, took_s = run(messages // PER_SAID[name])
        reader = {"mavlink": "pymavlink (mavutil)", "dronecan": "python-dronecan"}[name]
        print(
            f"{name}: {sent} messages, {wrong} not equal to what was said, by {reader}, in {took_s:.0f} s", flush=True
        )
    for child in multiprocessing.active_children():
        child.terminate()  # python-dronecan's process does not end by itself
    for one in threading.enumerate():
        if one is not threading.main_thread():
            one.join(timeout=1.0)


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # nor do its threads
