"""What is off by the same amount in all runs of a campaign: standard uncertainties that no scatter between runs shows.

    "common_uncertainty": {"air_temperature_k": 0.05, "air_humidity_percent": 0.5, "airflow_percent": 2.0,
                           "pressure_hpa": 1.0, "trigger_offset_s": 0.005, "clock_ppm": 50}      in campaign.json

A statement that leaves a key out has an ordinary laboratory's value there, and the results say so.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields, replace

from shockrig.files.file_table import FileTable
from shockrig.files.ranges import RANGES


@dataclass(frozen=True)
class CommonUncertainty:
    """One standard uncertainty of each input that all runs share; the values here are an ordinary laboratory's.

    Air: a handheld reference within its yearly calibration. Airflow: an ordinary anemometer, 2 to 5 %. Pressure: a
    station's barometer read in another room. Trigger: a switch or a line on a serial port. Clock: a crystal.

    `by_default` names what nobody stated.
    """

    air_temperature_k: float = 0.1
    air_humidity_percent: float = 1.0
    airflow_percent: float = 3.0
    pressure_hpa: float = 3.0
    trigger_offset_s: float = 0.01
    clock_ppm: float = 50.0
    by_default: frozenset[str] = field(default=frozenset(), compare=False)

    def document(self) -> dict[str, float]:
        """As in campaign.json, what is there by default included."""
        return {key: value for key, value in asdict(self).items() if key in INPUTS}


INPUTS = tuple(one.name for one in fields(CommonUncertainty) if one.name != "by_default")
ORDINARY_LABORATORY = CommonUncertainty(by_default=frozenset(INPUTS))
NOTHING_COMMON = CommonUncertainty(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def read_common(head: FileTable) -> CommonUncertainty | None:
    """What campaign.json states under `common_uncertainty`; None where it states nothing.

    Raises
    ------
    InputError
        A value is no number, negative, or beyond what can be: names file, key, remedy.
    """
    given = head.child("common_uncertainty")
    if given is None:
        return None
    stated = {key: given.number(key, RANGES[f"common_{key}"]) for key in INPUTS}
    told = {key: value for key, value in stated.items() if value is not None}
    return replace(ORDINARY_LABORATORY, **told, by_default=frozenset(INPUTS) - told.keys())
