"""MAVLink 2 (by pymavlink): airs and signs of life out, an autopilot's airspeed, pressure and position in.

HYGROMETER_SENSOR (12920)  int16 0.01 degC, uint16 0.01 %, uint8 id; it has no word for "no value": nothing is sent
NAMED_VALUE_FLOAT (251)    T_air, T_unc, RH_air, RH_unc, T_read, RH_read with the time [ms]; NaN where no value
STATUSTEXT (253)           a sensor that fell silent
VFR_HUD (74) airspeed      SCALED_PRESSURE (29) hPa      GLOBAL_POSITION_INT (33) 1e-7 deg, mm
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.links.ports import BytesPort
from shockrig.rig.links.said import SaidAir

ONBOARD_COMPUTER, PERIPHERAL, AUTOPILOT = 191, 158, 1  # MAV_COMPONENT
FRESH_S = 2.0  # an autopilot's value that is older is none
ASK_EVERY_S = 5.0
STREAM_INTERVAL_US = 200_000
WANTED_MESSAGES = {"VFR_HUD": 74, "SCALED_PRESSURE": 29, "GLOBAL_POSITION_INT": 33}
NAMES = ("T_air", "RH_air"), ("T_unc", "RH_unc"), ("T_read", "RH_read")
LONGEST_TEXT = 50


def dialect() -> Any:
    """pymavlink's messages. Raises BenchError where it is not installed."""
    try:
        from pymavlink.dialects.v20 import common  # type: ignore[import-untyped]
    except ImportError:
        raise BenchError("MAVLink needs pymavlink; pip install 'shockrig[ardupilot]'") from None
    return common


def hundredths(value: float, low: int, high: int) -> int:
    """A value in hundredths, as far as the message's type goes."""
    return min(max(round(100.0 * value), low), high)


def boot_ms(time_s: float) -> int:
    """A stamp of 32 bits."""
    return round(1000.0 * time_s) % (1 << 32)


class MavlinkEnd:
    """One end of a link: messages out through a port, messages in from it."""

    def __init__(self, port: BytesPort, system: int = 1, component: int = ONBOARD_COMPUTER) -> None:
        self.messages = dialect()
        self.port = port
        self._link = self.messages.MAVLink(None, system, component)
        self._link.robust_parsing = True

    def put(self, name: str, *fields: Any) -> None:
        """Send a message by its name, fields in the order of its definition."""
        message = getattr(self.messages, f"MAVLink_{name}_message")(*fields)
        data = message.pack(self._link)
        self._link.seq = (self._link.seq + 1) % 256
        self.port.send(data)

    def received(self) -> list[Any]:
        """Messages that came whole since the last call."""
        data = self.port.receive()
        found = self._link.parse_buffer(data) if data else None
        return [one for one in found or () if one.get_type() != "BAD_DATA"]

    def close(self) -> None:
        self.port.close()


class MavlinkSpeaker:
    """Says airs: sensor 0 is the air (corrected where it can be), sensor 1 what was read."""

    def __init__(self, end: MavlinkEnd) -> None:
        self.end = end

    @property
    def dropped(self) -> int:
        return self.end.port.dropped

    def send(self, said: SaidAir) -> None:
        for sensor, (temperature_c, humidity_percent) in enumerate(said.pairs()):
            if math.isfinite(temperature_c) and math.isfinite(humidity_percent):
                self.end.put(
                    "hygrometer_sensor",
                    sensor,
                    hundredths(temperature_c, -32768, 32767),
                    hundredths(humidity_percent, 0, 65535),
                )
        stamp = boot_ms(said.time_s)
        for names, values in zip(NAMES, (said.air, said.uncertainty, said.read), strict=True):
            for name, value in zip(names, values or (), strict=False):
                self.end.put("named_value_float", stamp, name.encode(), value)

    def tell(self, text: str, now_s: float) -> None:
        severity = self.end.messages.MAV_SEVERITY_WARNING
        self.end.put("statustext", severity, text.encode("ascii", "replace")[:LONGEST_TEXT])

    def beat(self, now_s: float) -> None:
        m = self.end.messages
        self.end.put("heartbeat", m.MAV_TYPE_ONBOARD_CONTROLLER, m.MAV_AUTOPILOT_INVALID, 0, 0, m.MAV_STATE_ACTIVE, 3)

    def close(self) -> None:
        self.end.close()


class AutopilotListener:
    """What an autopilot says of airspeed, pressure and position; it is asked for that until it does."""

    def __init__(self, end: MavlinkEnd) -> None:
        self.end = end
        self._heard: dict[str, tuple[float, float]] = {}
        self._asked_s = -math.inf

    def poll(self, now_s: float) -> None:
        """Take in what has come."""
        for message in self.end.received():
            match message.get_type():
                case "VFR_HUD":
                    self._take(now_s, airspeed_m_s=message.airspeed)
                case "SCALED_PRESSURE":
                    self._take(now_s, pressure_hpa=message.press_abs)
                case "GLOBAL_POSITION_INT":
                    self._take(
                        now_s,
                        latitude_deg=message.lat * 1e-7,
                        longitude_deg=message.lon * 1e-7,
                        altitude_m=message.alt * 1e-3,
                    )
                case "HEARTBEAT" if len(self.at(now_s)) < 5 and now_s - self._asked_s > ASK_EVERY_S:
                    self._ask(message, now_s)

    def _take(self, now_s: float, **values: float) -> None:
        self._heard |= {name: (value, now_s) for name, value in values.items() if math.isfinite(value)}

    def _ask(self, heartbeat: Any, now_s: float) -> None:
        self._asked_s = now_s
        to = heartbeat.get_srcSystem(), heartbeat.get_srcComponent()
        command = self.end.messages.MAV_CMD_SET_MESSAGE_INTERVAL
        for number in WANTED_MESSAGES.values():
            self.end.put("command_long", *to, command, 0, number, STREAM_INTERVAL_US, 0, 0, 0, 0, 0)

    def at(self, now_s: float) -> Mapping[str, float]:
        """The values that are not old."""
        return {name: value for name, (value, heard_s) in self._heard.items() if now_s - heard_s <= FRESH_S}


def vehicle_messages(
    end: MavlinkEnd, time_s: float, airspeed_m_s: float, pressure_hpa: float, position: Sequence[float]
) -> None:
    """What an autopilot streams of its flight; `position` is latitude, longitude [deg] and altitude [m]."""
    latitude, longitude, altitude = position
    stamp = boot_ms(time_s)
    end.put("vfr_hud", airspeed_m_s, airspeed_m_s, 0, 50, altitude, 0.0)
    end.put("scaled_pressure", stamp, pressure_hpa, 0.0, 2500)
    place = round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3)
    end.put("global_position_int", stamp, *place, round(altitude * 1e3), 0, 0, 0, 0)
