"""A person who carries the probes by hand; nothing that is recorded waits for an answer."""

from __future__ import annotations

from dataclasses import dataclass

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.seams import Air, Chambers, Clock, Move, Operator, Parts, SetPointsOnly

LOOK_S = 0.005


@dataclass(frozen=True)
class ManualSettings:
    """`confirm_arrival` asks for a second Enter as the probes arrive, which measures the transfer's duration (to about
    0.2 s, a person's reaction); `within_s` is how long the operator may take to move."""

    confirm_arrival: bool = False
    within_s: float = 300.0


class ManualStage:
    """Asks the operator to move the probes; the confirmation is the time stamp of the transfer."""

    Settings = ManualSettings

    def __init__(self, settings: ManualSettings, clock: Clock, operator: Operator, chambers: Chambers) -> None:
        self.settings = settings
        self._clock = clock
        self._operator = operator
        self._chambers = chambers
        self._asked = False
        self._left_s: float | None = None
        self._next_s = 0.0

    @classmethod
    def build(cls, name: str, settings: ManualSettings, parts: Parts) -> ManualStage:
        return cls(settings, parts.clock, parts.operator, parts.chambers)

    def open(self) -> None:
        self._asked = False

    def prepare(self, source: Air, destination: Air, airflow_m_s: float | None) -> None:
        """Wait until both airs are made and the probes are in the source air."""
        self._asked = False
        self._chambers.set_airs(source, destination, airflow_m_s)
        self._operator.ask("Put the probes into the source air, then press Enter.")

    def demand_transfer(self, duration_s: float) -> None:
        """A hand does not keep to a speed."""
        raise BenchError("transfer.duration_s is for a motorised stage: a hand does not keep to a speed; leave it out")

    def begin_transfer(self, duration_s: float | None = None) -> None:
        """Ask for the transfer. How long an answer may take is the operator's to keep: there is one deadline."""
        self._left_s, self._asked = None, True
        self._next_s = self._clock.now()
        self._operator.request(
            "Move the probes to the destination air; press Enter at the instant they leave the source air.",
            self.settings.within_s,
        )

    def due_s(self) -> float:
        return self._next_s if self._asked else float("inf")

    def poll(self) -> Move | None:
        if not self._asked:
            return None
        confirmed_s = self._operator.confirmed_s()
        if confirmed_s is None:
            self._next_s = self._clock.now() + LOOK_S
            return None
        if self._left_s is None and self.settings.confirm_arrival:
            self._left_s = confirmed_s
            self._operator.request(
                "Press Enter again at the instant the probes are in the destination air.", self.settings.within_s
            )
            return None
        self._asked = False
        if self._left_s is None:
            return Move(confirmed_s, None)
        return Move(self._left_s, confirmed_s)

    def make_safe(self) -> None:
        """A person's hand needs no stop; what was asked of it is taken back."""
        self._asked = False
        self._operator.leave()

    def close(self) -> None:
        pass


class PromptedChambers(SetPointsOnly):
    """Two airs that a person makes."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._airs = (Air(None, None), Air(None, None))
        self._around = AskedSurroundings(operator)

    def surround(self, pressure_hpa: float, irradiance_w_m2: float) -> None:
        self._around.ask(pressure_hpa, irradiance_w_m2)

    def set_airs(self, source: Air, destination: Air, airflow_m_s: float | None) -> None:
        self._airs = (source, destination)
        flow = "" if airflow_m_s is None else f", airflow {airflow_m_s:g} m/s"
        self._operator.ask(
            f"Set the source air to {_words(source)} and the destination air to {_words(destination)}{flow}; "
            "press Enter when both are steady."
        )

    def airs(self) -> tuple[Air, Air]:
        return self._airs


class AskedSurroundings:
    """Pressure and light that a person sets, asked for when they change."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._now: tuple[float, float] | None = None

    def ask(self, pressure_hpa: float, irradiance_w_m2: float) -> None:
        """Wait until the person has set both, where they are others than those before."""
        if self._now == (pressure_hpa, irradiance_w_m2):
            return
        light = f"the light to {irradiance_w_m2:g} W/m2" if irradiance_w_m2 else "the light off"
        self._operator.ask(f"Set the pressure to {pressure_hpa:g} hPa and {light}; press Enter when both are steady.")
        self._now = (pressure_hpa, irradiance_w_m2)


def _words(air: Air) -> str:
    temperature = "any temperature" if air.temperature_c is None else f"{air.temperature_c:g} degC"
    humidity = "any humidity" if air.humidity_percent is None else f"{air.humidity_percent:g} %RH"
    return f"{temperature} and {humidity}"
