"""Other people's benches: sensors of any shape in chambers of any kind, recorded as other labs' loggers record them.

The bodies are integrated on a fine grid of finite volumes, exactly in time, and share no code with `analysis`. A bench
writes a campaign folder as another lab would hand it over, with as much left out as that lab did not write down, and
returns what is true of it separately.
"""

from foreign_lab.air import ideal_step, one_approach, ramp, steps_of, two_stage
from foreign_lab.bodies import KINDS, ForeignBody, make_body
from foreign_lab.lab import Arrival, Lab, LabLogger, LabReference, LabRun, Written
from foreign_lab.recording import LabTruth, record

__all__ = [
    "KINDS",
    "Arrival",
    "Lab",
    "ForeignBody",
    "LabLogger",
    "LabReference",
    "LabRun",
    "LabTruth",
    "Written",
    "ideal_step",
    "make_body",
    "one_approach",
    "ramp",
    "record",
    "steps_of",
    "two_stage",
]
