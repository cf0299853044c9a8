"""A film that is as warm as the bead beside it reads, some seconds later: how flights of one sensor see it.

No bench states it: `shockrig learn` finds it with the film's lag, by the bead's readings alone.
"""

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.effect import Effect, InFlight, Needs, Parameter, Values, Words, unchanged

Array = NDArray[np.float64]


def _film_c(p: Values, time_s: Array, bead_c: Array) -> Array:
    """Temperature (n,) of the film along a flight, `bead_c` (n,) what the bead reads."""
    from scipy.signal import lfilter

    ahead = np.diff(time_s)
    if p["time_constant_s"] > 0 and (ahead > 0).any():
        kept = np.exp(-float(np.median(ahead[ahead > 0])) / p["time_constant_s"])
        bead_c = lfilter([1.0 - kept], [1.0, -kept], bead_c, zi=[kept * bead_c[0]])[0]
    return np.asarray(np.interp(time_s - p["behind_s"], time_s, bead_c))


EFFECT = Effect(
    id="film_beside_bead",
    link="readout",
    channels=("humidity",),
    equation=(
        "y = e / es(T), T(t) the bead's reading behind_s before, through a lag of time_constant_s; the film follows "
        "e es(T)^-activity"
    ),
    source="WMO-No. 8 (2021), I.4 (vapour pressure); air that is carried keeps its vapour pressure",
    parameters=(
        Parameter("behind_s", "s", -60.0, 60.0, (0.0,)),
        Parameter("activity", "1", 0.0, 1.0, (0.5,), none=None),
        Parameter("time_constant_s", "s", 0.0, 200.0, (0.0,)),
    ),
    apply=unchanged,
    words=Words(
        "The film is as warm as the bead was {behind_s} s before.",
        "Log the temperature of the film's own chip.",
    ),
    needs=Needs("needs flights: a bench has the airs themselves", lambda channel: False),
    in_flight=InFlight(film_c=_film_c, activity=lambda p: p["activity"]),
)
