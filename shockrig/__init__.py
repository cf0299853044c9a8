"""Characterization, diagnosis and flight correction of thermo-hygrometers for weather drones.

    import shockrig

    campaign = shockrig.import_log("steps.csv")          # or shockrig.read_campaign("campaign")
    found = campaign.characterize()                      # how fast the sensors are
    why = campaign.diagnose()                            # what that model gets wrong, and which effects cause it
    shockrig.plan(why)                                   # what to record next
    sensors = campaign.characterize(extend=why)
    flight = shockrig.correct("flight.csv", sensors)     # corrected, with uncertainty
    flight.plot()

Results show themselves in a notebook, and as tables (`to_frame`), labelled arrays (`to_xarray`) and figures (`plot`).
What is named here is imported when it is first used, so that `import shockrig` takes no time.
"""

from __future__ import annotations

import importlib

TYPE_CHECKING = False  # as typing has it, whose import alone would take a tenth of the time that --help takes
if TYPE_CHECKING:
    from typing import Any

    from shockrig.campaigns import ChainedCampaign, read_campaign
    from shockrig.characterizing import Characterized, characterize
    from shockrig.choosing_runs import Planned, plan
    from shockrig.correcting import CorrectedFlight, correct
    from shockrig.diagnosing import Diagnosed, diagnose
    from shockrig.examples import example
    from shockrig.files.campaign import Campaign
    from shockrig.files.errors import InputError
    from shockrig.files.fleet_file import Fleet, read_fleet
    from shockrig.files.flight import Flight
    from shockrig.files.profile import Profile, read_profile, write_profile
    from shockrig.flights import read_flight
    from shockrig.learning_flights import LearnedSensor, learn
    from shockrig.logs import import_log
    from shockrig.many_sensors import fleet

__all__ = [
    "Campaign",
    "ChainedCampaign",
    "Characterized",
    "CorrectedFlight",
    "Diagnosed",
    "Fleet",
    "Flight",
    "InputError",
    "LearnedSensor",
    "Planned",
    "Profile",
    "__version__",
    "characterize",
    "correct",
    "diagnose",
    "example",
    "fleet",
    "import_log",
    "learn",
    "plan",
    "read_campaign",
    "read_fleet",
    "read_flight",
    "read_profile",
    "write_profile",
]

__version__: str

_HOMES = {
    "Campaign": "files.campaign",
    "ChainedCampaign": "campaigns",
    "Characterized": "characterizing",
    "CorrectedFlight": "correcting",
    "Diagnosed": "diagnosing",
    "Fleet": "files.fleet_file",
    "Flight": "files.flight",
    "InputError": "files.errors",
    "LearnedSensor": "learning_flights",
    "Planned": "choosing_runs",
    "Profile": "files.profile",
    "characterize": "characterizing",
    "correct": "correcting",
    "diagnose": "diagnosing",
    "example": "examples",
    "fleet": "many_sensors",
    "import_log": "logs",
    "learn": "learning_flights",
    "plan": "choosing_runs",
    "read_campaign": "campaigns",
    "read_fleet": "files.fleet_file",
    "read_flight": "flights",
    "read_profile": "files.profile",
    "write_profile": "files.profile",
}


def __getattr__(name: str) -> Any:
    """A public name, imported from its home when it is first asked for (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("shockrig")
    elif name in _HOMES:
        value = getattr(importlib.import_module(f"shockrig.{_HOMES[name]}"), name)
    else:
        raise AttributeError(f"module 'shockrig' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
